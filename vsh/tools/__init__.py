"""What is checked where it comes in, and what stays as it was checked."""

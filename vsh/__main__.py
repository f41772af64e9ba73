"""`python -m vsh COMMAND …`: every command of the project by its short name."""

from _vsh_commands import main

if __name__ == "__main__":
    main()

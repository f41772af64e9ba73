"""Check the subject of a commit message, as CONTRIBUTING has it; pre-commit calls it with the file of the message."""

import re
import sys
from pathlib import Path

MOST = 72
SUBJECT = re.compile(r"[a-z][\w/.-]*: [A-Z][a-z]+ \S.*")


def fault_of(message):
    """What is wrong with a message; nothing where nothing is."""
    subject = message.split("\n", 1)[0]
    if subject.startswith(("Merge ", "Revert ", "fixup! ", "squash! ")):
        return ""
    if len(subject) > MOST:
        return f"The subject has {len(subject)} characters. Shorten it to {MOST} and move the rest into the body."
    if not SUBJECT.fullmatch(subject):
        return "The subject is not of the form 'area: Verb object', as in 'fit: Add a systematic floor to waves'."
    if ";" in subject:
        return "The subject has several topics. Make one commit of each."
    return ""


if __name__ == "__main__":
    fault = fault_of(Path(sys.argv[1]).read_text(encoding="utf-8"))
    print(fault, file=sys.stderr)
    sys.exit(bool(fault))

"""The defaults of every promised function and noun: one that changes is a change for every user, and stands in a table.

`python tests/vsh/tools/test_defaults.py` writes the table anew.
"""

import inspect
import json
from pathlib import Path

TABLE = Path(__file__).with_name("defaults.json")


def defaults():
    """The defaults by function and argument, as text: numbers to their last bit, objects by their class."""
    import fit
    import sim
    import study
    import vsh

    found: dict[str, dict[str, str]] = {}

    def walk(module, depth=0):
        for name in getattr(module, "__all__", []):
            thing = getattr(module, name)
            if inspect.ismodule(thing) and depth < 3:
                walk(thing, depth + 1)
            elif callable(thing) and is_ours(thing):
                members = inspect.getmembers(thing, inspect.isroutine) if inspect.isclass(thing) else []
                public = [(f".{key}", each) for key, each in members if not key.startswith("_")]
                for suffix, function in [("", thing), *public]:
                    add(f"{module.__name__}.{name}{suffix}", function)

    def add(name, function):
        if not is_ours(function):  # inherited
            return
        try:
            parameters = inspect.signature(function).parameters.values()
        except (TypeError, ValueError):  # of a class that is made in C, and a property
            return
        values = {each.name: shown(each.default) for each in parameters if each.default is not each.empty}
        if values:
            found[name] = values

    for module in (vsh, fit, sim, study):
        walk(module)
    return dict(sorted(found.items()))


def is_ours(thing):
    return (getattr(thing, "__module__", None) or "").split(".")[0] in ("vsh", "fit", "sim", "study")


def shown(value):
    plain = isinstance(value, (bool, int, float, str, type(None), tuple))
    return repr(value) if plain else type(value).__name__


def test_defaults_are_those_of_the_table():
    table, found = json.loads(TABLE.read_text(encoding="utf-8")), defaults()
    changed = [name for name in table.keys() | found.keys() if table.get(name) != found.get(name)]
    assert sorted(changed) == [], "write the table anew, and say in the changelog what changes for a user"


if __name__ == "__main__":
    rows = (f"{json.dumps(name)}: {json.dumps(row, ensure_ascii=False)}" for name, row in defaults().items())
    TABLE.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")

"""Writes the reference in docs/python.md from the stubs' signatures and the package's own documentation.

    python bindings/python/reference.py            # with palpate installed
    python bindings/python/reference.py --check    # ends with 1 if the page is not what it would write
"""

from __future__ import annotations

import ast
import inspect
import sys
from pathlib import Path

import palpate

HERE = Path(__file__).resolve().parent
PAGE = HERE.parents[1] / "docs" / "python.md"
BEGIN, END = "<!-- reference: made by bindings/python/reference.py -->", "<!-- end of the reference -->"


def documentation(thing: object, name: str) -> str:
    """What a thing says of itself; every public thing has to."""
    doc = inspect.getdoc(thing)
    if not doc:
        raise SystemExit(f"{name} has no documentation")
    return doc


def signature(function: ast.FunctionDef, name: str) -> str:
    """As the stubs have it, without the object that a method is called on."""
    arguments = ast.unparse(function.args)
    arguments = arguments.removeprefix("self").removeprefix("cls").removeprefix(", ")
    result = "" if name[0].isupper() and "." not in name else f" -> {ast.unparse(function.returns)}" if function.returns else ""
    return f"{name}({arguments}){result}".replace("_SlipRule", "str").replace("_Ablation", "str")


def decorated(function: ast.FunctionDef, name: str) -> bool:
    return any(ast.unparse(d) == name or ast.unparse(d).endswith("." + name) for d in function.decorator_list)


def described(doc: str) -> list[str]:
    """Google's sections as lists."""
    lines: list[str] = []
    section = False
    for line in doc.splitlines():
        if line in ("Args:", "Returns:", "Raises:"):
            section = line != "Returns:"
            lines += [f"*{line[:-1]}*", ""]
        elif line.startswith("        "):
            lines[-1] += " " + line.strip()
        elif line.startswith("    ") and section:
            name, _, text = line.strip().partition(": ")
            lines.append(f"- `{name}`: {text}")
        else:
            lines.append(line.strip())
    return lines


def reference() -> str:
    """The whole of it, Markdown."""
    stubs = ast.parse((HERE / "python" / "palpate" / "_palpate.pyi").read_text(encoding="utf-8"))
    out: list[str] = []
    for node in stubs.body:
        name = getattr(node, "name", "")
        if name.startswith("_") or name not in palpate.__all__:
            continue
        thing = getattr(palpate, name)
        if isinstance(node, ast.FunctionDef):
            out += [f"### `{name}`", "", "```text", signature(node, name), "```", "", *described(documentation(thing, name)), ""]
        elif isinstance(node, ast.ClassDef):
            out += [f"### `{name}`", ""]
            functions = [f for f in node.body if isinstance(f, ast.FunctionDef)]
            made = [f for f in functions if f.name == "__new__"]
            if made:
                out += ["```text", signature(made[0], name), "```", ""]
            out += [*described(documentation(thing, name)), ""]
            properties = [f for f in functions if decorated(f, "property")]
            if properties:
                out += ["| property | |", "|---|---|"]
                for f in properties:
                    doc = documentation(getattr(thing, f.name), f"{name}.{f.name}").replace("\n", " ").replace("|", "\\|")
                    out.append(f"| `{f.name}` | {doc} |")
                out.append("")
            for f in functions:
                if f.name.startswith("_") or decorated(f, "property") or decorated(f, "setter"):
                    continue
                full = f"{name}.{f.name}"
                out += ["```text", signature(f, full), "```", "", *described(documentation(getattr(thing, f.name), full)), ""]
    return "\n".join(out).strip() + "\n"


def main() -> int:
    page = PAGE.read_text(encoding="utf-8")
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    new = f"{before}{BEGIN}\n\n{reference()}\n{END}{after}"
    if "--check" in sys.argv:
        if new != page:
            print(f"{PAGE} is not what the package says; run bindings/python/reference.py", file=sys.stderr)
        return int(new != page)
    PAGE.write_text(new, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

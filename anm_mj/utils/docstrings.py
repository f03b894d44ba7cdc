"""What the docstrings say of the fields of a dataclass and of the parameters of a function."""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable
from dataclasses import is_dataclass
from typing import Any


def field_texts(config: type) -> dict[str, str]:
    """The docstring below each field of a dataclass or member of an enumeration, those of bases first, on one line."""
    texts: dict[str, str] = {}
    for base in reversed(config.__mro__):
        if is_dataclass(base) or base is config:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body  # type: ignore[attr-defined]
            for node, after in zip(body, [*body[1:], None], strict=True):
                target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
                if isinstance(target, ast.Name):
                    said = after.value if isinstance(after, ast.Expr) else None
                    texts[target.id] = " ".join(str(said.value).split()) if isinstance(said, ast.Constant) else ""
    return texts


def parameter_texts(function: Callable[..., Any]) -> tuple[str, str, dict[str, str]]:
    """The summary of a function, what follows it, and its parameters' texts, each on one line."""
    before, _, section = (inspect.getdoc(function) or "").partition("Args:\n")
    summary, _, more = before.partition("\n")
    texts: dict[str, str] = {}
    for line in section.splitlines():
        if parameter := re.fullmatch(r"    (\w+): (.*)", line):
            texts[parameter[1]] = parameter[2]
        elif line.startswith("        "):
            texts[[*texts][-1]] += f" {line.strip()}"
        elif line.strip():  # The next section.
            break
    return summary, " ".join(more.split()), texts

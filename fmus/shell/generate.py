"""Command of the build: everything that is generated for one component, and what it was generated from."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import rotordx.fmus
from rotordx.fmus.shell.header import component_source, ports_header
from rotordx.fmus.shell.model_description import fmi2_description, fmi3_description, token
from rotordx.fmus.shell.ports import Component


def generate(component: Component, version: str) -> dict[str, str | bytes]:
    """Generated files of a component: file name -> contents."""
    name = component.name
    files: dict[str, str | bytes] = {
        "fmi2.xml": fmi2_description(component, version),
        "fmi3.xml": fmi3_description(component, version),
    }
    if name in rotordx.fmus.diagnoser_ids():
        from rotordx.fmus.diagnosers import codegen

        files |= codegen.step_source(name)
        model, includes = codegen.model(name)
    else:
        model, includes = "Model", [f"fmus/{name}/{name}.hpp"]
    files[f"{name}_ports.hpp"] = ports_header(component, accessors=model == "Model")
    files[f"{name}_component.cpp"] = component_source(component, token(component, version), model, includes)
    return files


def write_if_changed(path: Path, contents: str | bytes) -> None:
    """Leaves the date of an unchanged file alone, so that nothing is compiled again."""
    contents = contents.encode() if isinstance(contents, str) else contents
    if not path.is_file() or path.read_bytes() != contents:
        path.write_bytes(contents)


def sources() -> list[Path]:
    """Source files of rotordx that the present process has imported."""
    modules = [module for name, module in sys.modules.items() if name.startswith("rotordx.")]
    return sorted(Path(module.__file__).resolve() for module in modules if module.__file__)


def main() -> None:
    """Write the files of one component and a dependency file for the build tool."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--version", required=True)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for file, contents in generate(rotordx.fmus.load_component(arguments.name), arguments.version).items():
        write_if_changed(arguments.folder / file, contents)
    dependencies = " ".join(str(path).replace(" ", "\\ ") for path in sources())
    (arguments.folder / "generate.d").write_text(f"{arguments.folder}/fmi2.xml: {dependencies}\n")


if __name__ == "__main__":
    main()

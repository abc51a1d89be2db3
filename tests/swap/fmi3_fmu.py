"""Builds small FMI 3 FMUs from a few lines of C, as another tool might: arrays, units, no function more than needed."""

from __future__ import annotations

import subprocess
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import fmpy

HEADERS = Path(fmpy.__file__).parent / "c-code"

SOURCE = """
#include <math.h>
#include <stdlib.h>
#include "fmi3Functions.h"

enum {{ {names}, COUNT = {count} }};
static const int offset_of[] = {{ {offsets} }}, size_of[] = {{ {sizes} }};
typedef struct {{ double v[COUNT]; fmi3InstanceEnvironment e; fmi3LogMessageCallback log; int calls; }} Instance;
#define V(x) (m->v + x)
#define LOG(text) m->log(m->e, fmi3Error, "error", text)

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference r[], size_t n,
    fmi3InstanceEnvironment e, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {{
  Instance *m = calloc(1, sizeof *m);
  m->e = e;
  m->log = log;
  return m;
}}
void fmi3FreeInstance(fmi3Instance c) {{ free(c); }}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean td, double t, double t0, fmi3Boolean sd,
                                       double t1) {{
  return fmi3OK;
}}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {{ return fmi3OK; }}
fmi3Status fmi3Reset(fmi3Instance c) {{
  Instance *m = c;
  for (int i = 0; i < COUNT; ++i) m->v[i] = 0;
  return fmi3OK;
}}
#define ACCESS(Type)                                                                                                  \
  fmi3Status fmi3Set##Type(fmi3Instance c, const unsigned r[], size_t n, const fmi3##Type v[], size_t values) {{      \
    for (size_t i = 0; i < n; ++i)                                                                                    \
      for (int j = 0; j < size_of[r[i]]; ++j) ((Instance *)c)->v[offset_of[r[i]] + j] = *v++;                         \
    return fmi3OK;                                                                                                    \
  }}                                                                                                                  \
  fmi3Status fmi3Get##Type(fmi3Instance c, const unsigned r[], size_t n, fmi3##Type v[], size_t values) {{            \
    for (size_t i = 0; i < n; ++i)                                                                                    \
      for (int j = 0; j < size_of[r[i]]; ++j) *v++ = ((Instance *)c)->v[offset_of[r[i]] + j];                         \
    return fmi3OK;                                                                                                    \
  }}
{access}
fmi3Status fmi3DoStep(fmi3Instance c, double time, double h, fmi3Boolean no_prior, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, double *last) {{
  Instance *m = c;
  *last = time + h;
  {step}
  return fmi3OK;
}}
"""


@dataclass(frozen=True)
class Port:
    """A variable: a scalar (`size` None) or an array."""

    name: str
    causality: str
    size: int | None = None
    unit: str = ""
    type: str = "Float64"

    @property
    def access(self) -> str:
        """What FMI's functions for it are called."""
        return "Int64" if self.type == "Enumeration" else self.type


Float64 = Port  #: the type that a port has unless another one is named


def build(folder: Path, name: str, variables: Sequence[Port], step: str, units: str = "", source: str = "") -> Path:
    """Write `folder/name.fmu`.

    Args:
        folder: an existing folder.
        name: also the model identifier.
        variables: all start at 0.
        step: C statements; V(name) points to a variable, `time`, `h`, `early`, `last` and `terminate` are known.
        units: elements of <UnitDefinitions>.
        source: the whole C source instead.
    """
    sizes = [v.size or 1 for v in variables]
    offsets = [sum(sizes[:i]) for i in range(len(sizes))]
    source = source or SOURCE.format(
        names=", ".join(f"{v.name} = {offset}" for v, offset in zip(variables, offsets, strict=True)),
        count=sum(sizes),
        offsets=", ".join(map(str, offsets)),
        sizes=", ".join(map(str, sizes)),
        access="\n".join(f"ACCESS({access})" for access in sorted({v.access for v in variables})),
        step=step,
    )
    (folder / f"{name}.c").write_text(source)
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    compiler = ["cc", "-shared", "-fPIC", "-O1", "-w", "-I", str(HEADERS), "-o", str(library)]
    subprocess.run([*compiler, str(folder / f"{name}.c"), "-lm"], check=True)
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _description(name, variables, units))
        archive.write(library, f"binaries/{fmpy.platform_tuple}/{library.name}")
    return path


def _description(name: str, variables: Sequence[Port], units: str) -> str:
    declared, outputs = "", ""
    for reference, v in enumerate(variables):
        unit = f' unit="{v.unit}"' if v.unit else ""
        value = "false" if v.type == "Boolean" else "0"
        start = f' start="{value}"' if v.causality != "output" else ""
        start += ' declaredType="Rotor"' if v.type == "Enumeration" else ""
        dimension = f'<Dimension start="{v.size}"/>' if v.size else ""
        declared += (
            f'<{v.type} name="{v.name}" valueReference="{reference}" causality="{v.causality}"{unit}{start}>'
            f"{dimension}</{v.type}>"
        )
        if v.causality == "output":
            outputs += f'<Output valueReference="{reference}"/>'
    declared += (
        f'<Float64 name="time" valueReference="{len(variables)}" causality="independent" variability="continuous"/>'
    )
    definitions = f"<UnitDefinitions>{units}</UnitDefinitions>" if units else ""
    if any(v.type == "Enumeration" for v in variables):
        items = "".join(f'<Item name="r{value}" value="{value}"/>' for value in range(-1, 5))
        definitions += f'<TypeDefinitions><EnumerationType name="Rotor">{items}</EnumerationType></TypeDefinitions>'
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" modelName="{name}" '
        f'instantiationToken="foreign"><CoSimulation modelIdentifier="{name}" '
        f'canHandleVariableCommunicationStepSize="true"/>{definitions}<ModelVariables>{declared}</ModelVariables>'
        f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )

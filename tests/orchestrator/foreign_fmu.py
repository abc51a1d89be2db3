"""Builds small FMI 2 FMUs from a few lines of C, as another tool might export them: flat names, scalars only."""

from __future__ import annotations

import re
import subprocess
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import fmpy

HEADERS = Path(fmpy.__file__).parent / "c-code"

SOURCE = """
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

enum {{ {enum}, COUNT }};
typedef struct {{ double v[COUNT]; const fmi2CallbackFunctions *callbacks; char *name; }} Instance;
static const double start[COUNT] = {{ {start} }};
#define V(x) (m->v[x])
{prelude}
#define LOG(...) m->callbacks->logger(m->callbacks->componentEnvironment, m->name, fmi2Error, "error", __VA_ARGS__)

const char *fmi2GetTypesPlatform(void) {{ return fmi2TypesPlatform; }}
const char *fmi2GetVersion(void) {{ return fmi2Version; }}
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String k[]) {{ return fmi2OK; }}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {{
  if (strcmp(guid, "foreign")) return NULL;
  {instantiate}
  Instance *m = calloc(1, sizeof *m);
  memcpy(m->v, start, sizeof start);
  m->callbacks = callbacks;
  m->name = strdup(name);
  return m;
}}
void fmi2FreeInstance(fmi2Component c) {{
  {free}
  free(((Instance *)c)->name);
  free(c);
}}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, double t, double t0, fmi2Boolean sd, double t1) {{
  return fmi2OK;
}}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {{ return fmi2OK; }}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {{
  Instance *m = c;
  (void)m;
  {initialise}
  return fmi2OK;
}}
fmi2Status fmi2Terminate(fmi2Component c) {{ return fmi2OK; }}
fmi2Status fmi2Reset(fmi2Component c) {{ memcpy(((Instance *)c)->v, start, sizeof start); return fmi2OK; }}
#define ACCESS(Type)                                                                                                  \
  fmi2Status fmi2Get##Type(fmi2Component c, const unsigned r[], size_t n, fmi2##Type v[]) {{                          \
    for (size_t i = 0; i < n; ++i) v[i] = ((Instance *)c)->v[r[i]];                                                   \
    return fmi2OK;                                                                                                    \
  }}                                                                                                                  \
  fmi2Status fmi2Set##Type(fmi2Component c, const unsigned r[], size_t n, const fmi2##Type v[]) {{                    \
    for (size_t i = 0; i < n; ++i) ((Instance *)c)->v[r[i]] = v[i];                                                   \
    return fmi2OK;                                                                                                    \
  }}
ACCESS(Real)
ACCESS(Integer)
ACCESS(Boolean)
fmi2Status fmi2DoStep(fmi2Component c, double time, double h, fmi2Boolean no_prior) {{
  Instance *m = c;
  (void)m;
  {step}
  return fmi2OK;
}}
#define UNUSED(name, ...) fmi2Status name(fmi2Component c, __VA_ARGS__) {{ return fmi2Error; }}
UNUSED(fmi2GetString, const unsigned r[], size_t n, fmi2String v[])
UNUSED(fmi2SetString, const unsigned r[], size_t n, const fmi2String v[])
UNUSED(fmi2GetFMUstate, fmi2FMUstate *s)
UNUSED(fmi2SetFMUstate, fmi2FMUstate s)
UNUSED(fmi2FreeFMUstate, fmi2FMUstate *s)
UNUSED(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
UNUSED(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
UNUSED(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
UNUSED(fmi2GetDirectionalDerivative, const unsigned u[], size_t nu, const unsigned k[], size_t nk, const double d[],
       double o[])
UNUSED(fmi2SetRealInputDerivatives, const unsigned r[], size_t n, const fmi2Integer o[], const double v[])
UNUSED(fmi2GetRealOutputDerivatives, const unsigned r[], size_t n, const fmi2Integer o[], double v[])
fmi2Status fmi2CancelStep(fmi2Component c) {{ return fmi2Error; }}
UNUSED(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *v)
UNUSED(fmi2GetRealStatus, const fmi2StatusKind k, double *v)
UNUSED(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *v)
UNUSED(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *v)
UNUSED(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *v)
"""


def build(
    folder: Path,
    name: str,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    parameters: dict[str, float] | None = None,
    types: Mapping[str, str] | None = None,
    step: str = "",
    initialise: str = "",
    instantiate: str = "",
    free: str = "",
    prelude: str = "",
    source: str = "",
) -> Path:
    """Write `folder/name.fmu`.

    Args:
        folder: an existing folder.
        name: also the model identifier.
        inputs: names of scalar inputs, which start at 0; dots and brackets become underscores in C.
        outputs: names of scalar outputs.
        parameters: start values by name.
        types: by name, of variables that are not Real: Integer, Boolean or Enumeration.
        step: C statements in which V(name) is a variable; `time` and `h` are known, LOG(...) logs an error.
        initialise: the same, at the end of the initialisation.
        instantiate: C statements at the beginning of the instantiation.
        free: C statements when the instance is freed.
        prelude: C that stands before all functions.
        source: the whole C source instead.
    """
    variables = [(n, "input", 0.0) for n in inputs]
    variables += [(n, "parameter", value) for n, value in (parameters or {}).items()]
    variables += [(n, "output", 0.0) for n in outputs]
    source = source or SOURCE.format(
        enum=", ".join(re.sub(r"\W", "_", n) for n, _, _ in variables) or "NONE",
        start=", ".join(str(value) for _, _, value in variables) or "0",
        step=step,
        initialise=initialise,
        instantiate=instantiate,
        free=free,
        prelude=prelude,
    )
    (folder / f"{name}.c").write_text(source)
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    subprocess.run(
        [
            "cc",
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            "-I",
            str(HEADERS),
            "-o",
            str(library),
            str(folder / f"{name}.c"),
            "-lm",
        ],
        check=True,
    )
    path = folder / f"{name}.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", model_description(name, variables, types or {}))
        archive.write(library, f"binaries/{fmpy.platform}/{library.name}")
    return path


def model_description(
    name: str, variables: Sequence[tuple[str, str, float]], types: Mapping[str, str] | None = None
) -> str:
    """An FMI 2 model description of (name, causality, start) variables and the types of those that are not Real."""
    scalars, outputs = "", ""
    for index, (variable, causality, start) in enumerate(variables):
        kind = (types or {}).get(variable, "Real")
        variability = "fixed" if causality == "parameter" else "continuous" if kind == "Real" else "discrete"
        number = {"Real": start, "Boolean": str(bool(start)).lower()}.get(kind, int(start))
        value = "" if causality == "output" else f' start="{number}"'
        declared = ' declaredType="Rotor"' if kind == "Enumeration" else ""
        scalars += (
            f'<ScalarVariable name="{variable}" valueReference="{index}" causality="{causality}" '
            f'variability="{variability}"><{kind}{declared}{value}/></ScalarVariable>'
        )
        if causality == "output":
            outputs += f'<Unknown index="{index + 1}"/>'
    structure = f"<Outputs>{outputs}</Outputs><InitialUnknowns>{outputs}</InitialUnknowns>" if outputs else ""
    items = "".join(f'<Item name="r{value}" value="{value}"/>' for value in range(-1, 5))
    enumeration = f'<TypeDefinitions><SimpleType name="Rotor"><Enumeration>{items}</Enumeration></SimpleType>'
    definitions = f"{enumeration}</TypeDefinitions>" if "Enumeration" in (types or {}).values() else ""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" modelName="{name}" '
        f'guid="foreign"><CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>'
        f"{definitions}<ModelVariables>{scalars}</ModelVariables><ModelStructure>{structure}</ModelStructure>"
        "</fmiModelDescription>"
    )

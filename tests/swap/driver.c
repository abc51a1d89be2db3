// Steps the library of an FMU: driver LIBRARY TOKEN INPUTS OUTPUTS. The two files are rows of doubles, the first one to
// initialise with: time and inputs, outputs. "tables.h" tells FMI's version, the number of values and the references.

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "tables.h"
#ifdef _WIN32
#include <windows.h>
#define OPEN(path) LoadLibraryA(path)
#define FIND(library, name) GetProcAddress(library, name)
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif
#define GET(name) name##TYPE* name = (name##TYPE*)FIND(library, #name)
#define COUNT(references) (sizeof(references) / sizeof(*references))
#define STEP 0.002

#if FMI == 2
#include "fmi2FunctionTypes.h"
static void say(void* environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String text, ...) {
  fprintf(stderr, "%s\n", text);
}
#else
#include "fmi3FunctionTypes.h"
static void say(void* environment, fmi3Status status, fmi3String category, fmi3String text) {
  fprintf(stderr, "%s\n", text);
}
#endif

int main(int argc, char** argv) {
  void* library = (void*)OPEN(argv[1]);
  FILE *given = fopen(argv[3], "rb"), *found = fopen(argv[4], "wb");
  if (!library || !given || !found) return 2;
  double row[1 + INPUTS], *inputs = row + 1, outputs[OUTPUTS];
#if FMI == 2
  GET(fmi2Instantiate);
  GET(fmi2SetupExperiment);
  GET(fmi2EnterInitializationMode);
  GET(fmi2ExitInitializationMode);
  GET(fmi2SetReal);
  GET(fmi2GetReal);
  GET(fmi2DoStep);
  GET(fmi2FreeInstance);
  fmi2CallbackFunctions callbacks = {say, calloc, free, 0, 0};
  void* m = fmi2Instantiate("x", fmi2CoSimulation, argv[2], "", &callbacks, 0, 0);
  if (!m || fmi2SetupExperiment(m, 0, 0, 0, 0, 0) || fmi2EnterInitializationMode(m)) return 3;
#define SET() fmi2SetReal(m, input_references, INPUTS, inputs)
#define RUN() fmi2ExitInitializationMode(m)
#define ADVANCE() fmi2DoStep(m, row[0] - STEP, STEP, 1)
#define READ() fmi2GetReal(m, output_references, OUTPUTS, outputs)
#define FREE() fmi2FreeInstance(m)
#else
  GET(fmi3InstantiateCoSimulation);
  GET(fmi3EnterInitializationMode);
  GET(fmi3ExitInitializationMode);
  GET(fmi3SetFloat64);
  GET(fmi3GetFloat64);
  GET(fmi3DoStep);
  GET(fmi3FreeInstance);
  fmi3Boolean event, terminate, early;
  double last;
  void* m = fmi3InstantiateCoSimulation("x", argv[2], "", 0, 0, 0, 0, 0, 0, 0, say, 0);
  if (!m || fmi3EnterInitializationMode(m, 0, 0, 0, 0, 0)) return 3;
#define SET() fmi3SetFloat64(m, input_references, COUNT(input_references), inputs, INPUTS)
#define RUN() fmi3ExitInitializationMode(m)
#define ADVANCE() fmi3DoStep(m, row[0] - STEP, STEP, 1, &event, &terminate, &early, &last)
#define READ() fmi3GetFloat64(m, output_references, COUNT(output_references), outputs, OUTPUTS)
#define FREE() fmi3FreeInstance(m)
#endif
  for (int k = 0; fread(row, sizeof(double), 1 + INPUTS, given) == 1 + INPUTS; ++k) {
    if (INPUTS && SET()) return 4;
    if (k == 0 ? RUN() : ADVANCE()) return 5;
    if (READ() || fwrite(outputs, sizeof(double), OUTPUTS, found) != OUTPUTS) return 6;
  }
  FREE();
  return fclose(found) ? 7 : 0;
}

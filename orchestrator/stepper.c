// The inner loop of a co-simulation: steps FMI 2 and FMI 3 components in a fixed order and logs what they put out.
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

// FMI 2 and FMI 3 number their statuses alike; up to a warning, a call has done its work.
enum { kStatusWarning = fmi2Warning };

// Mirrored by ctypes structures in stepper.py.
typedef struct {
  int32_t fmi;       // 2 or 3
  int32_t substeps;  // how many steps of the FMU make one step of the system
  void* instance;
  void (*set)(void);  // the FMU's SetReal or SetFloat64, and so on
  void (*do_step)(void);
  void (*get)(void);
  const uint32_t* input_references;
  size_t input_reference_count;
  size_t input_size;
  const uint32_t* input_columns;  // where on the bus each input value is
  const double* input_scale;      // input = scale * value on the bus + offset; null if they are the same
  const double* input_offset;
  double* inputs;  // scratch
  const uint32_t* output_references;
  size_t output_reference_count;
  size_t output_size;
  double* outputs;                // where the FMU puts them: on the bus, unless they have to be converted
  const uint32_t* output_places;  // which of them each value on the bus is
  const double* output_scale;     // value on the bus = scale * output + offset; null if they are the same
  const double* output_offset;
  size_t output_width;
  double* converted_outputs;  // their place on the bus
} Component;

// The bus is one row of all signals: those from outside, then the outputs of each component.
typedef struct {
  const Component* components;  // in the order of computation
  size_t component_count;
  double* bus;
  size_t width;
  size_t external_width;
  double start_time;
  double step_size;
} Plan;

// kTerminate: the FMU asks for the end; kStuck: it returned early and had not moved on.
typedef enum { kSetInputs, kDoStep, kGetOutputs, kTerminate, kStuck, kNone } Stage;

typedef struct {
  double time;
  int32_t component;
  int32_t stage;
  int32_t status;
} Failure;

static int set_inputs(const Component* c, const double* bus) {
  if (c->input_reference_count == 0) return fmi2OK;
  for (size_t i = 0; i < c->input_size; ++i) c->inputs[i] = bus[c->input_columns[i]];
  if (c->input_scale) {
    for (size_t i = 0; i < c->input_size; ++i) c->inputs[i] = c->input_scale[i] * c->inputs[i] + c->input_offset[i];
  }
  if (c->fmi == 2) {
    return ((fmi2SetRealTYPE*)c->set)(c->instance, c->input_references, c->input_reference_count, c->inputs);
  }
  return ((fmi3SetFloat64TYPE*)c->set)(c->instance, c->input_references, c->input_reference_count, c->inputs,
                                       c->input_size);
}

// Steps from `time` to `time + step_size`; what an FMU leaves out by returning early is made up for.
static Stage do_step(const Component* c, double time, double step_size, int* status) {
  if (c->fmi == 2) {
    *status = ((fmi2DoStepTYPE*)c->do_step)(c->instance, time, step_size, fmi2True);
    return *status > kStatusWarning ? kDoStep : kNone;
  }
  const double end = time + step_size, tolerance = 1e-9 * step_size;
  while (true) {
    fmi3Boolean event_needed = fmi3False, terminate = fmi3False, early_return = fmi3False;
    double reached = time;
    *status = ((fmi3DoStepTYPE*)c->do_step)(c->instance, time, step_size, fmi3True, &event_needed, &terminate,
                                            &early_return, &reached);
    if (*status > kStatusWarning) return kDoStep;
    if (terminate) return kTerminate;
    if (!early_return || reached >= end - tolerance) return kNone;
    if (!(reached > time)) return kStuck;
    time = reached;
    step_size = end - reached;
  }
}

static int get_outputs(const Component* c) {
  if (c->output_reference_count == 0) return fmi2OK;
  const int status =
      c->fmi == 2 ? ((fmi2GetRealTYPE*)c->get)(c->instance, c->output_references, c->output_reference_count, c->outputs)
                  : ((fmi3GetFloat64TYPE*)c->get)(c->instance, c->output_references, c->output_reference_count,
                                                  c->outputs, c->output_size);
  if (c->output_scale) {
    for (size_t i = 0; i < c->output_width; ++i) {
      c->converted_outputs[i] = c->output_scale[i] * c->outputs[c->output_places[i]] + c->output_offset[i];
    }
  }
  return status;
}

// Makes one component's step; returns the stage at which it failed, and in `time` when that was.
static Stage step_component(const Component* c, const double* bus, double* time, double step_size, int* status) {
  if ((*status = set_inputs(c, bus)) > kStatusWarning) return kSetInputs;
  const double begin = *time, substep = step_size / c->substeps;
  for (int32_t i = 0; i < c->substeps; ++i) {
    *time = begin + i * substep;
    const Stage stage = do_step(c, *time, substep, status);
    if (stage != kNone) return stage;
  }
  if ((*status = get_outputs(c)) > kStatusWarning) return kGetOutputs;
  return kNone;
}

// Makes `count` steps, the first of which starts at start_time + first * step_size. Before each, the external signals
// are taken from the next row of `external`, unless that is null; after each whose number, counted from 1, is a
// multiple of `log_every`, the bus is appended to `log`, unless that is null. Returns the number of steps made: fewer
// than `count` if a component failed, see `failure`.
EXPORT int64_t rotordx_advance(const Plan* plan, int64_t first, int64_t count, const double* external, double* log,
                               int64_t log_every, Failure* failure) {
  for (int64_t k = 0; k < count; ++k) {
    const double time = plan->start_time + (double)(first + k) * plan->step_size;
    if (external) memcpy(plan->bus, external + (size_t)k * plan->external_width, plan->external_width * sizeof(double));
    for (size_t i = 0; i < plan->component_count; ++i) {
      int status = fmi2OK;
      double reached = time;
      const Stage stage = step_component(&plan->components[i], plan->bus, &reached, plan->step_size, &status);
      if (stage != kNone) {
        *failure = (Failure){reached, (int32_t)i, (int32_t)stage, status};
        return k;
      }
    }
    if (log && (first + k + 1) % log_every == 0) {
      memcpy(log, plan->bus, plan->width * sizeof(double));
      log += plan->width;
    }
  }
  return count;
}

// The logger of FMI 2 is variadic, which a Python function cannot be: format here and call the function that the
// importer has given as environment.
EXPORT void rotordx_fmi2_log(void* environment, const char* instance, int status, const char* category,
                             const char* format, ...) {
  (void)instance;
  (void)category;
  char message[2048];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(message, sizeof message, format, arguments);
  va_end(arguments);
  ((void (*)(int, const char*))environment)(status, message);
}

// The inner loop of a co-simulation: steps FMI 2 and FMI 3 components in a fixed order and logs what they put out.
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

// FMI 2 and FMI 3 number their statuses alike; up to a warning, a call has done its work.
static bool failed(int status) { return status < fmi2OK || status > fmi2Warning; }

// The types that values of a call may have, numbered from 0.
#define REALS(X) X(double) X(float)
#define INTEGERS(X) X(int8_t) X(uint8_t) X(int16_t) X(uint16_t) X(int32_t) X(uint32_t) X(int64_t) X(uint64_t)
#define TYPE(name) k_##name,
typedef enum { REALS(TYPE) INTEGERS(TYPE) } Type;

// The structures are mirrored by ctypes structures in stepper.py.

// One call of a function that sets or gets all values of one type, and how they come from the bus or go there.
typedef struct {
  void (*function)(void);
  int32_t type;  // Type
  const uint32_t* references;
  size_t reference_count;
  void* values;     // as the FMU has them
  double* numbers;  // the same as doubles; the same memory if they are doubles, and for outputs on the bus if possible
  size_t size;      // how many of them
  double lowest;    // what an integer may be
  double highest;
  const uint32_t* columns;  // of each element on the bus
  const uint32_t* places;   // of each element of outputs among the numbers; those of inputs are in order
  const double* scale;      // factor and summand on the way that the call goes; null: none
  const double* offset;
  size_t width;  // number of elements of outputs that have to be moved
} Call;

typedef struct {
  int32_t fmi;       // 2 or 3
  int32_t substeps;  // how many steps of the FMU make one step of the system
  void* instance;
  void (*do_step)(void);
  const Call* inputs;
  size_t input_count;
  const Call* outputs;
  size_t output_count;
} Component;

// The bus is one row of all signals: those from outside, then the outputs of each component.
typedef struct {
  const Component* components;  // in the order of computation
  size_t component_count;
  double* bus;
  size_t width;
  size_t external_width;
  double step_size;
} Plan;

// kTerminate: the FMU asks for the end; kStuck: it returned early and had not moved on; kMisfit: an input cannot be
// what the bus has.
typedef enum { kSetInputs, kDoStep, kGetOutputs, kTerminate, kStuck, kMisfit, kNone } Stage;

typedef struct {
  double time;
  int32_t component;
  int32_t stage;
  int32_t status;
  int32_t call;  // of kMisfit: which of the inputs' calls, which of its values, and what that should have been
  int32_t place;
  double value;
} Failure;

// All functions that set or get numbers differ in the type behind the pointer only.
static int exchange(const Component* c, const Call* call) {
  if (c->fmi == 2) {
    return ((fmi2GetRealTYPE*)call->function)(c->instance, call->references, call->reference_count, call->values);
  }
  return ((fmi3GetFloat64TYPE*)call->function)(c->instance, call->references, call->reference_count, call->values,
                                               call->size);
}

// Puts the numbers of a call into the FMU's type, integers as the nearest one; returns the index of the first number
// that no value of this type is near to, or the size if there is none.
static size_t to_values(const Call* call) {
  if (call->type != k_float) {
    for (size_t i = 0; i < call->size; ++i) {
      const double nearest = round(call->numbers[i]);
      if (!(nearest >= call->lowest && nearest <= call->highest)) return i;
      call->numbers[i] = nearest;
    }
  }
#define TO_VALUES(name)                                                                        \
  case k_##name:                                                                               \
    for (size_t i = 0; i < call->size; ++i) ((name*)call->values)[i] = (name)call->numbers[i]; \
    break;
  switch (call->type) { REALS(TO_VALUES) INTEGERS(TO_VALUES) }
  return call->size;
}

static void to_numbers(const Call* call) {
#define TO_NUMBERS(name)                                                                         \
  case k_##name:                                                                                 \
    for (size_t i = 0; i < call->size; ++i) call->numbers[i] = (double)((name*)call->values)[i]; \
    break;
  switch (call->type) { REALS(TO_NUMBERS) INTEGERS(TO_NUMBERS) }
}

static Stage set_inputs(const Component* c, const double* bus, Failure* failure) {
  for (size_t k = 0; k < c->input_count; ++k) {
    const Call* call = &c->inputs[k];
    for (size_t i = 0; i < call->size; ++i) call->numbers[i] = bus[call->columns[i]];
    if (call->scale) {
      for (size_t i = 0; i < call->size; ++i) call->numbers[i] = call->scale[i] * call->numbers[i] + call->offset[i];
    }
    if (call->type != k_double) {
      const size_t misfit = to_values(call);
      if (misfit < call->size) {
        failure->call = (int32_t)k;
        failure->place = (int32_t)misfit;
        failure->value = call->numbers[misfit];
        return kMisfit;
      }
    }
    if (failed(failure->status = exchange(c, call))) return kSetInputs;
  }
  return kNone;
}

static Stage get_outputs(const Component* c, double* bus, Failure* failure) {
  for (size_t k = 0; k < c->output_count; ++k) {
    const Call* call = &c->outputs[k];
    if (failed(failure->status = exchange(c, call))) return kGetOutputs;
    if (call->type != k_double) to_numbers(call);
    for (size_t i = 0; i < call->width; ++i) {
      const double number = call->numbers[call->places[i]];
      bus[call->columns[i]] = call->scale ? call->scale[i] * number + call->offset[i] : number;
    }
  }
  return kNone;
}

// Steps from `time` to `time + step_size`; what an FMU leaves out by returning early is made up for.
static Stage do_step(const Component* c, double time, double step_size, Failure* failure) {
  if (c->fmi == 2) {
    failure->status = ((fmi2DoStepTYPE*)c->do_step)(c->instance, time, step_size, fmi2True);
    return failed(failure->status) ? kDoStep : kNone;
  }
  const double end = time + step_size, tolerance = 1e-9 * step_size;
  while (true) {
    fmi3Boolean event_needed = fmi3False, terminate = fmi3False, early_return = fmi3False;
    double reached = time;
    failure->status = ((fmi3DoStepTYPE*)c->do_step)(c->instance, time, step_size, fmi3True, &event_needed, &terminate,
                                                    &early_return, &reached);
    if (failed(failure->status)) return kDoStep;
    if (terminate) return kTerminate;
    if (!early_return || reached >= end - tolerance) return kNone;
    if (!(reached > time)) return kStuck;
    time = reached;
    step_size = end - reached;
  }
}

// Makes one component's step from `time` on; returns the stage at which it failed, and in `failure` what there is to
// know about that.
static Stage step_component(const Component* c, double* bus, double time, double step_size, Failure* failure) {
  failure->time = time;
  Stage stage = set_inputs(c, bus, failure);
  if (stage != kNone) return stage;
  const double substep = step_size / c->substeps;
  for (int32_t i = 0; i < c->substeps; ++i) {
    failure->time = time + i * substep;
    stage = do_step(c, failure->time, substep, failure);
    if (stage != kNone) return stage;
  }
  return get_outputs(c, bus, failure);
}

// Makes `count` steps, the first of which starts at first * step_size. Before each, the external signals
// are taken from the next row of `external`, unless that is null; after each whose number, counted from 1, is a
// multiple of `log_every`, the bus is appended to `log`, unless that is null. Returns the number of steps made: fewer
// than `count` if a component failed, see `failure`.
EXPORT int64_t rotordx_advance(const Plan* plan, int64_t first, int64_t count, const double* external, double* log,
                               int64_t log_every, Failure* failure) {
  for (int64_t k = 0; k < count; ++k) {
    const double time = (double)(first + k) * plan->step_size;
    if (external) memcpy(plan->bus, external + (size_t)k * plan->external_width, plan->external_width * sizeof(double));
    for (size_t i = 0; i < plan->component_count; ++i) {
      const Stage stage = step_component(&plan->components[i], plan->bus, time, plan->step_size, failure);
      if (stage != kNone) {
        failure->component = (int32_t)i;
        failure->stage = (int32_t)stage;
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

// Between two steps, and in the initialisation: sets the inputs of a component from the bus, or puts its outputs there.
// Returns whether that went well, see `failure`.
EXPORT bool rotordx_set_inputs(const Plan* plan, size_t component, Failure* failure) {
  *failure = (Failure){.component = (int32_t)component};
  failure->stage = (int32_t)set_inputs(&plan->components[component], plan->bus, failure);
  return failure->stage == kNone;
}

EXPORT bool rotordx_get_outputs(const Plan* plan, size_t component, Failure* failure) {
  *failure = (Failure){.component = (int32_t)component};
  failure->stage = (int32_t)get_outputs(&plan->components[component], plan->bus, failure);
  return failure->stage == kNone;
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

// FMI 3.0 for co-simulation, as a thin layer over `Instance`; what is not supported is in fmi3_unsupported.cpp.
#include "fmi3Functions.h"
#include "fmus/shell/access.hpp"

namespace {

using namespace rotordx;

constexpr unsigned kInstantiated = in(Phase::kInstantiated);
constexpr unsigned kInitialisation = in(Phase::kInitialisation);
constexpr unsigned kStep = in(Phase::kStep);
constexpr unsigned kAny = kInstantiated | kInitialisation | kStep | in(Phase::kTerminated);

fmi3Status status(bool ok) { return ok ? fmi3OK : fmi3Error; }

void emit(const Log& log, Severity severity, const char* text) {
  const bool error = severity == Severity::kError;
  reinterpret_cast<fmi3LogMessageCallback>(log.callback)(log.environment, error ? fmi3Error : fmi3OK,
                                                         error ? "logStatusError" : "logEvents", text);
}

/// The instance, if there is one and it is in one of the phases.
Instance* enter(fmi3Instance handle, unsigned phases, const char* call) {
  auto* instance = static_cast<Instance*>(handle);
  return instance != nullptr && require(*instance, phases, call) ? instance : nullptr;
}

Log log_to(fmi3String name, fmi3Boolean debug, fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback) {
  return {emit, reinterpret_cast<void (*)()>(callback), environment, name != nullptr ? name : "", debug};
}

}  // namespace

extern "C" {

const char* fmi3GetVersion() { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance handle, fmi3Boolean on, size_t, const fmi3String[]) {
  Instance* instance = enter(handle, kAny, "fmi3SetDebugLogging");
  if (instance != nullptr) instance->log.debug = on;
  return status(instance != nullptr);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean debug,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback) {
  fail(log_to(name, debug, environment, callback), "%s: model exchange is not supported", component.name);
  return nullptr;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String, fmi3Boolean, fmi3Boolean debug,
                                         fmi3Boolean event_mode, fmi3Boolean, const fmi3ValueReference[],
                                         size_t intermediate_variables, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback callback, fmi3IntermediateUpdateCallback) {
  const Log log = log_to(name, debug, environment, callback);
  if (event_mode || intermediate_variables > 0) {
    fail(log, "%s: event mode and intermediate variables are not supported", component.name);
    return nullptr;
  }
  return create(name, token, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String, fmi3String, fmi3Boolean, fmi3Boolean debug,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback callback,
                                               fmi3ClockUpdateCallback, fmi3LockPreemptionCallback,
                                               fmi3UnlockPreemptionCallback) {
  fail(log_to(name, debug, environment, callback), "%s: scheduled execution is not supported", component.name);
  return nullptr;
}

void fmi3FreeInstance(fmi3Instance handle) { destroy(static_cast<Instance*>(handle)); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance handle, fmi3Boolean, fmi3Float64, fmi3Float64 start_time,
                                       fmi3Boolean has_stop_time, fmi3Float64 stop_time) {
  Instance* instance = enter(handle, kInstantiated, "fmi3EnterInitializationMode");
  return status(instance != nullptr && set_up(*instance, start_time, has_stop_time, stop_time) &&
                enter_initialisation(*instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance handle) {
  Instance* instance = enter(handle, kInitialisation, "fmi3ExitInitializationMode");
  return status(instance != nullptr && exit_initialisation(*instance));
}

fmi3Status fmi3Terminate(fmi3Instance handle) {
  Instance* instance = enter(handle, kInitialisation | kStep, "fmi3Terminate");
  return status(instance != nullptr && terminate(*instance));
}

fmi3Status fmi3Reset(fmi3Instance handle) {
  Instance* instance = enter(handle, kAny, "fmi3Reset");
  return status(instance != nullptr && reset(*instance));
}

fmi3Status fmi3DoStep(fmi3Instance handle, fmi3Float64 time, fmi3Float64 communication_step, fmi3Boolean,
                      fmi3Boolean* event_handling_needed, fmi3Boolean* terminate_simulation, fmi3Boolean* early_return,
                      fmi3Float64* last_successful_time) {
  Instance* instance = enter(handle, kStep, "fmi3DoStep");
  if (instance == nullptr) return fmi3Error;
  const bool ok = do_step(*instance, time, communication_step);
  *event_handling_needed = *terminate_simulation = *early_return = false;
  *last_successful_time = instance->time();
  return status(ok);
}

fmi3Status fmi3GetFloat64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t size) {
  Instance* instance = enter(handle, kAny, "fmi3GetFloat64");
  return status(instance != nullptr && get<Addressing::kArrays>(*instance, vr, n, values, size));
}

fmi3Status fmi3SetFloat64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t size) {
  Instance* instance = enter(handle, kAny, "fmi3SetFloat64");
  return status(instance != nullptr && set<Addressing::kArrays>(*instance, vr, n, values, size));
}

fmi3Status fmi3GetInt64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, fmi3Int64 values[], size_t size) {
  Instance* instance = enter(handle, kAny, "fmi3GetInt64");
  return status(instance != nullptr && get<Addressing::kArrays>(*instance, vr, n, values, size));
}

fmi3Status fmi3SetInt64(fmi3Instance handle, const fmi3ValueReference vr[], size_t n, const fmi3Int64 values[],
                        size_t size) {
  Instance* instance = enter(handle, kAny, "fmi3SetInt64");
  return status(instance != nullptr && set<Addressing::kArrays>(*instance, vr, n, values, size));
}

fmi3Status fmi3GetFMUState(fmi3Instance handle, fmi3FMUState* state) {
  Instance* instance = enter(handle, kAny, "fmi3GetFMUState");
  return status(instance != nullptr && get_state(*instance, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance handle, fmi3FMUState state) {
  Instance* instance = enter(handle, kAny, "fmi3SetFMUState");
  return status(instance != nullptr && set_state(*instance, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance handle, fmi3FMUState* state) {
  Instance* instance = enter(handle, kAny, "fmi3FreeFMUState");
  if (instance != nullptr) free_state(state);
  return status(instance != nullptr);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance handle, fmi3FMUState, size_t* size) {
  Instance* instance = enter(handle, kAny, "fmi3SerializedFMUStateSize");
  if (instance != nullptr) *size = serialised_size();
  return status(instance != nullptr);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance handle, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
  Instance* instance = enter(handle, kAny, "fmi3SerializeFMUState");
  return status(instance != nullptr && serialise(*instance, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance handle, const fmi3Byte bytes[], size_t size, fmi3FMUState* state) {
  Instance* instance = enter(handle, kAny, "fmi3DeserializeFMUState");
  return status(instance != nullptr && deserialise(*instance, bytes, size, state));
}

}  // extern "C"

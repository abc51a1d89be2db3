// FMI 2.0 for co-simulation, as a thin layer over `Instance`.
#include "fmi2Functions.h"
#include "fmus/shell/access.hpp"

namespace {

using namespace rotordx;

constexpr unsigned kInstantiated = in(Phase::kInstantiated);
constexpr unsigned kInitialisation = in(Phase::kInitialisation);
constexpr unsigned kStep = in(Phase::kStep);
constexpr unsigned kAny = kInstantiated | kInitialisation | kStep | in(Phase::kTerminated);

fmi2Status status(bool ok) { return ok ? fmi2OK : fmi2Error; }

/// The callback reads its message as a printf format, and '#' as the start of a value reference.
void emit(const Log& log, Severity severity, const char* text) {
  char escaped[1024];
  std::size_t n = 0;
  for (; *text != '\0' && n < sizeof escaped - 2; ++text) {
    if (*text == '%' || *text == '#') escaped[n++] = *text;
    escaped[n++] = *text;
  }
  escaped[n] = '\0';
  const bool error = severity == Severity::kError;
  reinterpret_cast<fmi2CallbackLogger>(log.callback)(log.environment, log.instance_name, error ? fmi2Error : fmi2OK,
                                                     error ? "logStatusError" : "logEvents", escaped);
}

/// The instance, if there is one and it is in one of the phases.
Instance* enter(fmi2Component c, unsigned phases, const char* call) {
  auto* instance = static_cast<Instance*>(c);
  return instance != nullptr && require(*instance, phases, call) ? instance : nullptr;
}

fmi2Status unsupported(fmi2Component c, const char* call) {
  if (c != nullptr) fail(*static_cast<Instance*>(c), "%s is not supported", call);
  return fmi2Error;
}

/// What an importer may ask for although this component has no variable of the kind.
fmi2Status none(fmi2Component c, size_t count, const char* call) { return count == 0 ? fmi2OK : unsupported(c, call); }

fmi2Status discard(fmi2Component c, const char* call) {
  unsupported(c, call);
  return fmi2Discard;
}

}  // namespace

extern "C" {

const char* fmi2GetTypesPlatform() { return fmi2TypesPlatform; }

const char* fmi2GetVersion() { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t, const fmi2String[]) {
  Instance* instance = enter(c, kAny, "fmi2SetDebugLogging");
  if (instance != nullptr) instance->log.debug = on;
  return status(instance != nullptr);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String,
                              const fmi2CallbackFunctions* functions, fmi2Boolean, fmi2Boolean debug) {
  Log log{emit, nullptr, nullptr, name != nullptr ? name : "", debug != fmi2False};
  if (functions != nullptr) {
    log.callback = reinterpret_cast<void (*)()>(functions->logger);
    log.environment = functions->componentEnvironment;
  }
  if (type != fmi2CoSimulation) {
    fail(log, "%s: model exchange is not supported", component.name);
    return nullptr;
  }
  return create(name, guid, log);
}

void fmi2FreeInstance(fmi2Component c) { destroy(static_cast<Instance*>(c)); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean, fmi2Real, fmi2Real start_time, fmi2Boolean has_stop_time,
                               fmi2Real stop_time) {
  Instance* instance = enter(c, kInstantiated, "fmi2SetupExperiment");
  return status(instance != nullptr && set_up(*instance, start_time, has_stop_time, stop_time));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  Instance* instance = enter(c, kInstantiated, "fmi2EnterInitializationMode");
  return status(instance != nullptr && enter_initialisation(*instance));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  Instance* instance = enter(c, kInitialisation, "fmi2ExitInitializationMode");
  return status(instance != nullptr && exit_initialisation(*instance));
}

fmi2Status fmi2Terminate(fmi2Component c) {
  Instance* instance = enter(c, kInitialisation | kStep, "fmi2Terminate");
  return status(instance != nullptr && terminate(*instance));
}

fmi2Status fmi2Reset(fmi2Component c) {
  Instance* instance = enter(c, kAny, "fmi2Reset");
  return status(instance != nullptr && reset(*instance));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real communication_step, fmi2Boolean) {
  Instance* instance = enter(c, kStep, "fmi2DoStep");
  return status(instance != nullptr && do_step(*instance, time, communication_step));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  Instance* instance = enter(c, kAny, "fmi2GetReal");
  return status(instance != nullptr && get<Addressing::kElements>(*instance, vr, n, value, n));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  Instance* instance = enter(c, kAny, "fmi2SetReal");
  return status(instance != nullptr && set<Addressing::kElements>(*instance, vr, n, value, n));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
  Instance* instance = enter(c, kAny, "fmi2GetInteger");
  return status(instance != nullptr && get<Addressing::kElements>(*instance, vr, n, value, n));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
  Instance* instance = enter(c, kAny, "fmi2SetInteger");
  return status(instance != nullptr && set<Addressing::kElements>(*instance, vr, n, value, n));
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference[], size_t n, fmi2Boolean[]) {
  return none(c, n, "fmi2GetBoolean");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference[], size_t n, const fmi2Boolean[]) {
  return none(c, n, "fmi2SetBoolean");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference[], size_t n, fmi2String[]) {
  return none(c, n, "fmi2GetString");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference[], size_t n, const fmi2String[]) {
  return none(c, n, "fmi2SetString");
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
  Instance* instance = enter(c, kAny, "fmi2GetFMUstate");
  return status(instance != nullptr && get_state(*instance, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  Instance* instance = enter(c, kAny, "fmi2SetFMUstate");
  return status(instance != nullptr && set_state(*instance, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) {
  Instance* instance = enter(c, kAny, "fmi2FreeFMUstate");
  if (instance != nullptr) free_state(state);
  return status(instance != nullptr);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate, size_t* size) {
  Instance* instance = enter(c, kAny, "fmi2SerializedFMUstateSize");
  if (instance != nullptr) *size = serialised_size();
  return status(instance != nullptr);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
  Instance* instance = enter(c, kAny, "fmi2SerializeFMUstate");
  return status(instance != nullptr && serialise(*instance, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate* state) {
  Instance* instance = enter(c, kAny, "fmi2DeSerializeFMUstate");
  return status(instance != nullptr && deserialise(*instance, bytes, size, state));
}

// Steps are never asynchronous: the only status there is to report is the time reached.
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real* value) {
  Instance* instance = enter(c, kAny, "fmi2GetRealStatus");
  if (instance == nullptr) return fmi2Error;
  if (kind != fmi2LastSuccessfulTime) return discard(c, "fmi2GetRealStatus of this kind");
  *value = instance->time();
  return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean* value) {
  if (c == nullptr) return fmi2Error;
  if (kind != fmi2Terminated) return discard(c, "fmi2GetBooleanStatus of this kind");
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind, fmi2Status*) { return discard(c, "fmi2GetStatus"); }

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind, fmi2Integer*) {
  return discard(c, "fmi2GetIntegerStatus");
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind, fmi2String*) {
  return discard(c, "fmi2GetStringStatus");
}

fmi2Status fmi2CancelStep(fmi2Component c) { return unsupported(c, "fmi2CancelStep"); }

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t n, const fmi2Integer[],
                                       const fmi2Real[]) {
  return none(c, n, "fmi2SetRealInputDerivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference[], size_t n, const fmi2Integer[],
                                        fmi2Real[]) {
  return none(c, n, "fmi2GetRealOutputDerivatives");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference[], size_t, const fmi2ValueReference[],
                                        size_t, const fmi2Real[], fmi2Real[]) {
  return unsupported(c, "fmi2GetDirectionalDerivative");
}

// Model exchange.
fmi2Status fmi2EnterEventMode(fmi2Component c) { return unsupported(c, "fmi2EnterEventMode"); }

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo*) { return unsupported(c, "fmi2NewDiscreteStates"); }

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return unsupported(c, "fmi2EnterContinuousTimeMode"); }

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean, fmi2Boolean*, fmi2Boolean*) {
  return unsupported(c, "fmi2CompletedIntegratorStep");
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real) { return unsupported(c, "fmi2SetTime"); }

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real[], size_t) {
  return unsupported(c, "fmi2SetContinuousStates");
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real[], size_t) { return unsupported(c, "fmi2GetDerivatives"); }

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real[], size_t) {
  return unsupported(c, "fmi2GetEventIndicators");
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real[], size_t) {
  return unsupported(c, "fmi2GetContinuousStates");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real[], size_t) {
  return unsupported(c, "fmi2GetNominalsOfContinuousStates");
}

}  // extern "C"

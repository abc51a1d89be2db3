#include "fmus/shell/instance.hpp"

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace rotordx {
namespace {

const char* name_of(Phase phase) {
  static constexpr const char* kNames[] = {"instantiated", "in initialisation mode", "in step mode", "terminated"};
  return kNames[static_cast<int>(phase)];
}

void emit(const Log& log, Severity severity, const char* format, std::va_list arguments) {
  if (log.callback == nullptr || (severity == Severity::kInformation && !log.debug)) return;
  char text[512];
  std::vsnprintf(text, sizeof text, format, arguments);
  log.emit(log, severity, text);
}

/// The serialised state begins with what it belongs to.
struct Header {
  char token[64];
  std::uint64_t size;
};

Header header() {
  Header result{};
  std::strncpy(result.token, component.token, sizeof result.token - 1);
  result.size = state_size();
  return result;
}

}  // namespace

void inform(const Instance& instance, const char* format, ...) {
  std::va_list arguments;
  va_start(arguments, format);
  emit(instance.log, Severity::kInformation, format, arguments);
  va_end(arguments);
}

bool fail(const Instance& instance, const char* format, ...) {
  std::va_list arguments;
  va_start(arguments, format);
  emit(instance.log, Severity::kError, format, arguments);
  va_end(arguments);
  return false;
}

bool fail(const Log& log, const char* format, ...) {
  std::va_list arguments;
  va_start(arguments, format);
  emit(log, Severity::kError, format, arguments);
  va_end(arguments);
  return false;
}

Instance* create(const char* instance_name, const char* token, const Log& log) {
  if (instance_name == nullptr || *instance_name == '\0') {
    fail(log, "%s: an instance needs a name", component.name);
    return nullptr;
  }
  if (token == nullptr || std::strcmp(token, component.token) != 0) {
    fail(log, "%s: the model description (%s) does not belong to this library (%s)", component.name,
         token == nullptr ? "no token" : token, component.token);
    return nullptr;
  }
  const std::size_t name_size = std::strlen(instance_name) + 1;
  auto* instance = static_cast<Instance*>(std::calloc(1, sizeof(Instance) + component.model_size));
  auto* name = static_cast<char*>(std::malloc(name_size));
  if (instance == nullptr || name == nullptr) {
    std::free(instance);
    std::free(name);
    fail(log, "%s: out of memory", component.name);
    return nullptr;
  }
  std::memcpy(name, instance_name, name_size);
  instance->name = name;
  instance->log = log;
  instance->log.instance_name = name;
  component.construct(instance->model(), component.start);
  inform(*instance, "instantiated %s", component.name);
  return instance;
}

void destroy(Instance* instance) {
  if (instance == nullptr) return;
  std::free(instance->name);
  std::free(instance);
}

bool refuse_phase(const Instance& instance, const char* call) {
  return fail(instance, "%s is not allowed while the instance is %s", call, name_of(instance.clock.phase));
}

bool set_up(Instance& instance, double start_time, bool has_stop_time, double stop_time) {
  if (!std::isfinite(start_time)) return fail(instance, "the start time %g s is not finite", start_time);
  if (has_stop_time && !(stop_time >= start_time)) {
    return fail(instance, "the stop time %g s lies before the start time %g s", stop_time, start_time);
  }
  instance.clock.start_time = start_time;
  return true;
}

bool enter_initialisation(Instance& instance) {
  instance.clock.phase = Phase::kInitialisation;
  instance.clock.initialised = 0;
  return true;
}

bool settle(Instance& instance) {
  if (instance.clock.initialised) return true;
  if (const char* error = component.parameter_error(instance.model())) return fail(instance, "%s", error);
  component.initialise(instance.model(), instance.clock.start_time);
  instance.clock.initialised = 1;
  return true;
}

bool exit_initialisation(Instance& instance) {
  if (!settle(instance)) return false;
  instance.clock.phase = Phase::kStep;
  inform(instance, "initialised at t = %g s", instance.clock.start_time);
  return true;
}

bool terminate(Instance& instance) {
  instance.clock.phase = Phase::kTerminated;
  inform(instance, "terminated at t = %g s", instance.time());
  return true;
}

bool reset(Instance& instance) {
  std::memset(&instance.clock, 0, sizeof instance.clock);
  component.construct(instance.model(), component.start);
  inform(instance, "reset");
  return true;
}

bool do_step(Instance& instance, double time, double communication_step) {
  const double step_size = instance.values()[component.step_size];
  const double now = instance.time();
  if (!(std::fabs(time - now) <= 0.5 * step_size)) {
    return fail(instance, "the step is to begin at t = %.9g s, but this instance is at t = %.9g s", time, now);
  }
  std::int64_t count = 1;
  if (communication_step != step_size) {
    const double ratio = communication_step / step_size;
    const double whole = std::floor(ratio + 0.5);
    if (!(whole >= 1 && whole <= 9e15 && std::fabs(ratio - whole) <= 1e-9 * whole)) {
      return fail(instance, "the communication step %.9g s is not a multiple of step_size = %.9g s", communication_step,
                  step_size);
    }
    count = static_cast<std::int64_t>(whole);
  }
  component.advance(instance.model(), instance.clock.start_time, instance.clock.step, count, step_size);
  instance.clock.step += count;
  return true;
}

std::size_t state_size() { return sizeof(Instance::Clock) + component.model_size; }

bool get_state(const Instance& instance, void** state) {
  if (*state == nullptr) *state = std::malloc(state_size());
  if (*state == nullptr) return fail(instance, "out of memory");
  std::memcpy(*state, &instance.clock, state_size());
  return true;
}

bool set_state(Instance& instance, const void* state) {
  if (state == nullptr) return fail(instance, "there is no FMU state to set");
  std::memcpy(&instance.clock, state, state_size());
  return true;
}

void free_state(void** state) {
  if (state == nullptr) return;
  std::free(*state);
  *state = nullptr;
}

std::size_t serialised_size() { return sizeof(Header) + state_size(); }

bool serialise(const Instance& instance, const void* state, void* bytes, std::size_t size) {
  if (state == nullptr) return fail(instance, "there is no FMU state to serialise");
  if (size < serialised_size()) {
    return fail(instance, "a serialised state takes %zu bytes, the buffer has %zu", serialised_size(), size);
  }
  const Header prefix = header();
  std::memcpy(bytes, &prefix, sizeof prefix);
  std::memcpy(static_cast<char*>(bytes) + sizeof prefix, state, state_size());
  return true;
}

bool deserialise(const Instance& instance, const void* bytes, std::size_t size, void** state) {
  const Header expected = header();
  if (size != serialised_size() || std::memcmp(bytes, &expected, sizeof expected) != 0) {
    return fail(instance, "the %zu bytes are not a serialised state of this component", size);
  }
  if (*state == nullptr) *state = std::malloc(state_size());
  if (*state == nullptr) return fail(instance, "out of memory");
  std::memcpy(*state, static_cast<const char*>(bytes) + sizeof expected, state_size());
  return true;
}

}  // namespace rotordx

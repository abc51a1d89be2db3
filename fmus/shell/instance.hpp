// One instance of the component, independent of the FMI version: life cycle, stepping, state copies, messages.
#pragma once

#include <cstddef>
#include <cstdint>

#include "fmus/shell/component.hpp"

namespace rotordx {

enum class Severity { kInformation, kError };

enum class Phase : std::int32_t { kInstantiated, kInitialisation, kStep, kTerminated };

/// Set of phases in which a call is allowed.
constexpr unsigned in(Phase phase) { return 1u << static_cast<unsigned>(phase); }

/// Where messages go. `emit` knows the signature of the importer's callback.
struct Log {
  void (*emit)(const Log& log, Severity severity, const char* text);
  void (*callback)();
  void* environment;
  const char* instance_name;
  bool debug;  ///< information is passed on too, not errors alone
};

/// Followed in memory by the model. `clock` and the model together are the FMU state, copied as one block.
struct alignas(16) Instance {
  Log log;
  char* name;
  struct alignas(16) Clock {
    double start_time;
    std::int64_t step;  ///< internal steps done since start_time
    Phase phase;
    std::int32_t initialised;  ///< 0 if inputs or parameters changed since the outputs were initialised
  } clock;

  void* model() { return this + 1; }
  const void* model() const { return this + 1; }
  double* values() { return static_cast<double*>(model()); }
  const double* values() const { return static_cast<const double*>(model()); }
  double time() const { return clock.start_time + static_cast<double>(clock.step) * values()[component.step_size]; }
};

/// Messages in printf format; `fail` returns false.
void inform(const Instance& instance, const char* format, ...) __attribute__((format(printf, 2, 3)));
bool fail(const Instance& instance, const char* format, ...) __attribute__((format(printf, 2, 3)));
bool fail(const Log& log, const char* format, ...) __attribute__((format(printf, 2, 3)));

/// A new instance, or nullptr (with a message) if the token is not that of this component.
Instance* create(const char* instance_name, const char* token, const Log& log);
void destroy(Instance* instance);

/// False, with a message, unless the instance is in one of the phases.
bool refuse_phase(const Instance& instance, const char* call);
inline bool require(const Instance& instance, unsigned phases, const char* call) {
  return (in(instance.clock.phase) & phases) || refuse_phase(instance, call);
}

bool set_up(Instance& instance, double start_time, bool has_stop_time, double stop_time);
bool enter_initialisation(Instance& instance);
bool exit_initialisation(Instance& instance);
bool terminate(Instance& instance);
bool reset(Instance& instance);

/// Initial state and outputs, if inputs or parameters changed since they were last computed.
bool settle(Instance& instance);

/// Advances by a whole number of internal steps; on failure nothing has changed.
bool do_step(Instance& instance, double time, double communication_step);

/// Copies of the FMU state are blocks of this size.
std::size_t state_size();
bool get_state(const Instance& instance, void** state);
bool set_state(Instance& instance, const void* state);
void free_state(void** state);
std::size_t serialised_size();
bool serialise(const Instance& instance, const void* state, void* bytes, std::size_t size);
bool deserialise(const Instance& instance, const void* bytes, std::size_t size, void** state);

}  // namespace rotordx

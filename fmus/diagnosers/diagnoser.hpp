// The model of every diagnoser: its generated step between the ports and the state. Include `<id>_ports.hpp` first.
#pragma once

#include <cstring>

namespace rotordx {

/// Signature of a function that CasADi prints: arguments, results, and work space, which these functions do not need.
using GeneratedFunction = int(const double** arguments, double** results, int*, double*, int);

/// `start() -> (state, outputs)`, `step(state, inputs, time, parameters) -> (state, outputs)`; both come from the
/// diagnoser's step.py, and firmware calls the same two.
template <int kStates, GeneratedFunction start, GeneratedFunction step_function>
struct Diagnoser {
  Ports ports;
  double state[kStates];

  void initialise(double) {
    double* results[] = {state, ports.value + Ports::kOutputs};
    start(nullptr, results, nullptr, nullptr, 0);
  }

  /// A sample belongs to the end of the step over which its command acted.
  void step(double time, double dt) {
    const double sample_time = time + dt;
    double next[kStates];
    const double* arguments[] = {state, ports.value, &sample_time, ports.value + Ports::kStepSize};
    double* results[] = {next, ports.value + Ports::kOutputs};
    step_function(arguments, results, nullptr, nullptr, 0);
    std::memcpy(state, next, sizeof state);
  }

  const char* parameter_error() const { return nullptr; }
};

}  // namespace rotordx

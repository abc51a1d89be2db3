// Gyro, motion capture and velocity filter: what the vehicle knows about its motion.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>

#include "fmus/shell/random.hpp"
#include "sensors_ports.hpp"

namespace rotordx {

/// Equations and port table: README.md.
struct Model {
  static constexpr int kCaptures = 64;

  Ports ports;
  Random random;
  std::int64_t tick, capture_period, capture_latency;  // in steps
  double captures[kCaptures][6];                       // position, euler; a ring
  double filter_position[3];                           // F applied to the captured position

  /// The past before the start is uniform motion at `initial_velocity`, captured like everything after it: neither
  /// latency nor the velocity filter causes a transient.
  void initialise(double) {
    const double dt = ports.step_size();
    random = Random(ports.seed(), kStream);
    capture_period = std::lround(std::fmax(1.0, ports.motion_capture_period() / dt));
    const double longest_latency = static_cast<double>((kCaptures - 1) * capture_period);
    capture_latency = std::lround(std::fmin(longest_latency, ports.motion_capture_latency() / dt));
    tick = kCaptures * capture_period;  // positive for every capture of the past
    for (int age = kCaptures - 1; age >= 0; --age) {
      const double time_ago = static_cast<double>(age * capture_period) * dt;
      capture(tick - age * capture_period, ports.true_position() - time_ago * ports.initial_velocity());
    }
    start_filter(dt);
  }

  void step(double, double dt) {
    filter(dt);
    ++tick;
    if (tick % capture_period == 0) capture(tick, ports.true_position());
    measure();
  }

  const char* parameter_error() const {
    if (ports.seed() != std::floor(ports.seed())) return "seed must be a whole number";
    const double longest_latency = (kCaptures - 1) * std::fmax(ports.motion_capture_period(), ports.step_size());
    return ports.motion_capture_latency() <= longest_latency
               ? nullptr
               : "motion_capture_latency must not exceed 63 times motion_capture_period";
  }

 private:
  using Vector3 = Eigen::Vector3d;
  static constexpr std::uint64_t kStream = 0x73656e736f7273;  // keeps equal seeds of several FMUs apart

  double* slot(std::int64_t capture_tick) { return captures[capture_tick / capture_period % kCaptures]; }

  void capture(std::int64_t capture_tick, const Vector3& position) {
    double* value = slot(capture_tick);
    for (int i = 0; i < 3; ++i) {
      value[i] = position[i] + ports.motion_capture_position_noise_std() * random.normal();
      value[3 + i] = ports.true_euler()[i] + ports.motion_capture_attitude_noise_std() * random.normal();
    }
  }

  /// Outputs from the newest capture that has arrived, and a new gyro sample.
  void measure() {
    double* delivered = slot(tick - capture_latency);
    ports.position() = Vector3::Map(delivered);
    ports.euler() = Vector3::Map(delivered + 3);
    for (int i = 0; i < 3; ++i) {
      ports.body_rate()[i] =
          ports.true_body_rate()[i] + ports.gyro_bias()[i] + ports.gyro_noise_std() * random.normal();
    }
    ports.vertical_velocity() = ports.velocity()[2];
  }

  /// State in which the filter is after a long uniform motion: periodic over the hold of one capture, so that state
  /// (filter_position - position, velocity) after a delivery obeys z = Phi z - (distance moved in a period, 0).
  void start_filter(double dt) {
    const double period = static_cast<double>(capture_period) * dt;
    const double x = ports.velocity_filter_bandwidth() * period, decay = std::exp(-x);
    const Vector3 distance = period / ((1.0 - decay) * (1.0 - decay)) * ports.initial_velocity();
    const std::int64_t since_delivery = (tick - capture_latency) % capture_period;
    const double age = static_cast<double>(capture_latency + since_delivery) * dt;
    const Vector3 captured = ports.true_position() - age * ports.initial_velocity();
    Vector3::Map(filter_position) = captured - (1.0 - decay * (1.0 - x)) * distance;
    ports.velocity() = decay * x * ports.velocity_filter_bandwidth() * distance;
    measure();
    filter(static_cast<double>(since_delivery) * dt);
    ports.vertical_velocity() = ports.velocity()[2];
  }

  /// Filter (33), s F(s), exact for the held capture: F's output approaches it as its double pole says.
  void filter(double dt) {
    const double bandwidth = ports.velocity_filter_bandwidth(), x = bandwidth * dt, decay = std::exp(-x);
    const Vector3 error = Vector3::Map(filter_position) - ports.position(), velocity = ports.velocity();
    Vector3::Map(filter_position) = ports.position() + decay * ((1.0 + x) * error + dt * velocity);
    ports.velocity() = decay * ((1.0 - x) * velocity - bandwidth * x * error);
  }
};

}  // namespace rotordx

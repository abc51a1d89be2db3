// The quadrotor's rigid body in gusts: from rotor speeds to motion.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "fmus/shell/random.hpp"
#include "model_terms.h"
#include "plant_ports.hpp"

namespace rotordx {

/// Equations and port table: README.md.
struct Model {
  Ports ports;
  double state[13];        // position, velocity, quaternion, body rate: as model_terms.h has it
  double rotor_speed[4];   // rad/s, at the end of the previous step
  double gust[6];          // of unit variance, before clipping
  double gust_decay[6];    // over one step
  double gust_renewal[6];  // what a step adds to the variance, its root
  Random random;

  void initialise(double) {
    segment<3>(0) = ports.initial_position();
    segment<3>(3) = ports.initial_velocity();
    quaternion_from_euler(ports.initial_euler().data(), state + 6);
    segment<3>(10) = ports.initial_body_rate();
    Rotors::Map(rotor_speed) = ports.rotor_speed();
    random = Random(ports.seed(), kStream);
    for (int i = 0; i < 6; ++i) {
      gust_decay[i] = std::exp(-ports.step_size() / ports.gust_time_constant()[i]);
      gust_renewal[i] = std::sqrt(1.0 - gust_decay[i] * gust_decay[i]);
      gust[i] = random.normal();
    }
    disturb();
    output();
  }

  void step(double, double dt) {
    for (int i = 0; i < 6; ++i) {
      if (ports.gust_std()[i] > 0.0) gust[i] = gust_decay[i] * gust[i] + gust_renewal[i] * random.normal();
    }
    disturb();
    const int substeps = static_cast<int>(std::ceil(dt / kLongestSubstep - 1e-9));
    const Rotors change = (ports.rotor_speed() - Rotors::Map(rotor_speed)) / substeps;
    for (int i = 0; i < substeps; ++i) {
      runge_kutta(Rotors::Map(rotor_speed) + i * change, change, dt / substeps);
    }
    segment<4>(6).normalize();
    Rotors::Map(rotor_speed) = ports.rotor_speed();
    output();
  }

  const char* parameter_error() const {
    return ports.seed() == std::floor(ports.seed()) ? nullptr : "seed must be a whole number";
  }

 private:
  using State = Eigen::Matrix<double, 13, 1>;
  using Rotors = Eigen::Vector4d;
  static constexpr std::uint64_t kStream = 0x706c616e74;
  static constexpr double kLongestSubstep = 1e-3;  // s

  template <int size>
  Eigen::Map<Eigen::Matrix<double, size, 1>> segment(int first) {
    return Eigen::Map<Eigen::Matrix<double, size, 1>>(state + first);
  }

  State derivative(const State& at, const Rotors& speed) const {
    State result;
    rigid_body_derivative(at.data(), speed.data(), ports.disturbance().data(), ports.vehicle_parameters(),
                          result.data());
    return result;
  }

  /// Classical fourth-order step of length h, in which the rotor speeds go linearly from `speed` to `speed + change`.
  void runge_kutta(const Rotors& speed, const Rotors& change, double h) {
    const Rotors middle = speed + 0.5 * change;
    const State start = State::Map(state);
    const State k1 = derivative(start, speed);
    const State k2 = derivative(start + 0.5 * h * k1, middle);
    const State k3 = derivative(start + 0.5 * h * k2, middle);
    const State k4 = derivative(start + h * k3, speed + change);
    State::Map(state) = start + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
  }

  void disturb() {
    const auto unclipped = ports.gust_std().cwiseProduct(Eigen::Matrix<double, 6, 1>::Map(gust));
    ports.disturbance() =
        unclipped.cwiseMin(ports.gust_limit()).cwiseMax(-ports.gust_limit()) + ports.constant_disturbance();
  }

  void output() {
    ports.position() = segment<3>(0);
    ports.velocity() = segment<3>(3);
    ports.quaternion() = segment<4>(6);
    ports.body_rate() = segment<3>(10);
    euler_from_quaternion(state + 6, ports.euler().data());
    specific_force(state, ports.rotor_speed().data(), ports.disturbance().data(), ports.vehicle_parameters(),
                   ports.specific_force().data());
  }
};

}  // namespace rotordx

// Speed controllers, motors and every injected rotor fault: from commanded to actual rotor speeds.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "esc_ports.hpp"
#include "model_terms.h"

namespace rotordx {

/// Equations and port table: README.md.
struct Model {
  Ports ports;

  void initialise(double start_time) {
    ports.rotor_speed() = ports.rotor_speed_command();
    ports.loss_of_effectiveness() = loss_of_effectiveness(start_time);
  }

  /// Command, losses and sag are held over the step, so the lag is exact.
  void step(double time, double dt) {
    const Rotors loss = loss_of_effectiveness(time);
    const double battery = std::fmax(0.0, 1.0 - ports.battery_sag_rate() * time);
    const Rotors command =
        ports.rotor_speed_command().array().max(ports.rotor_speed_min()).min(ports.rotor_speed_max());
    const Rotors target = ((1.0 - loss) * battery).sqrt() * command;  // thrust goes with the square of speed
    const Eigen::Vector4d speed = ports.rotor_speed();
    motor_lag(speed.data(), target.data(), &dt, ports.vehicle_parameters(), ports.rotor_speed().data());
    ports.loss_of_effectiveness() = loss;
  }

  const char* parameter_error() const {
    for (int slot = 0; slot < kSlots; ++slot) {
      const double rotor = ports.fault_rotor()[slot], profile = ports.fault_profile()[slot];
      if (rotor != std::floor(rotor)) {
        return "fault_rotor must hold whole numbers: rotor 1 to 4, or 0 for a slot that is not in use";
      }
      if (profile != std::floor(profile)) {
        return "fault_profile must hold whole numbers: 0 abrupt, 1 incipient, 2 function, 3 intermittent";
      }
      if (static_cast<Profile>(profile) == Profile::kIntermittent &&
          !(ports.fault_on_time()[slot] + ports.fault_off_time()[slot] > 0.0)) {
        return "fault_on_time and fault_off_time of an intermittent fault must not both be 0";
      }
    }
    return ports.rotor_speed_min() < ports.rotor_speed_max() ? nullptr
                                                             : "rotor_speed_min must be below rotor_speed_max";
  }

 private:
  using Rotors = Eigen::Array4d;
  enum class Profile { kAbrupt, kIncipient, kFunction, kIntermittent };
  static constexpr int kSlots = 8;
  static constexpr double kLargestLoss = 0.99;

  /// Losses of the four rotors at an instant: 1 - prod(1 - loss of the slot) over the slots of a rotor.
  Rotors loss_of_effectiveness(double time) const {
    Rotors effectiveness = Rotors::Ones();
    for (int slot = 0; slot < kSlots; ++slot) {
      const int rotor = static_cast<int>(ports.fault_rotor()[slot]);
      if (rotor > 0) effectiveness[rotor - 1] *= 1.0 - slot_loss(slot, time);
    }
    return 1.0 - effectiveness;
  }

  double slot_loss(int slot, double time) const {
    constexpr double kRounding = 1e-9;  // s: k * step may fall just short of an onset that lies on the grid
    if (time + kRounding < ports.fault_onset()[slot] || time + kRounding >= ports.fault_end()[slot]) return 0.0;
    const double age = std::fmax(0.0, time - ports.fault_onset()[slot]);
    const double magnitude = ports.fault_magnitude()[slot];
    switch (static_cast<Profile>(ports.fault_profile()[slot])) {
      case Profile::kIncipient:
        return -magnitude * std::expm1(-ports.fault_growth_rate()[slot] * age);
      case Profile::kFunction: {
        const double sine = std::sin(ports.fault_sine_rate()[slot] * age + ports.fault_sine_phase()[slot]);
        const double loss = magnitude + ports.fault_slope()[slot] * age + ports.fault_sine_amplitude()[slot] * sine;
        return std::fmin(std::fmax(loss, 0.0), kLargestLoss);
      }
      case Profile::kIntermittent: {
        const double on_time = ports.fault_on_time()[slot];
        return std::fmod(age + kRounding, on_time + ports.fault_off_time()[slot]) < on_time ? magnitude : 0.0;
      }
      case Profile::kAbrupt:
        break;
    }
    return magnitude;
  }
};

}  // namespace rotordx

// Double-loop trajectory controller: from references and measurements to commanded rotor speeds.
#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

#include "controller_ports.hpp"
#include "model_terms.h"

namespace rotordx {

/// Equations and port table: README.md.
struct Model {
  Ports ports;
  double inverse_allocation[16];  // by columns: squared rotor speeds of a unit of thrust and of each torque
  double position_integral[3];    // m/s2
  double rate_integral[3];        // rad/s2
  double filtered_rate[3];        // rad/s
  double lagged_demand[3];        // rad/s2, state of the lead

  /// Hover until the first measurement.
  void initialise(double) {
    Eigen::Matrix4d::Map(inverse_allocation) = allocation_matrix().inverse();
    ports.thrust_command() = ports.mass() * ports.gravity();
    command_rotors();
  }

  void step(double, double dt) {
    const Acceleration acceleration = acceleration_demand();
    const Attitude attitude = attitude_demand(acceleration.value);
    ports.euler_command() = attitude.euler;
    const double upright = std::fmax(0.5, std::cos(ports.euler()[0]) * std::cos(ports.euler()[1]));
    ports.thrust_command() = ports.mass() * (ports.gravity() - acceleration.value.z()) / upright;
    const Vector3 rate_error = rate_demand(attitude.euler) - filter_rate(dt);
    const Vector3 demand = ports.rate_gain().cwiseProduct(rate_error) + Vector3::Map(rate_integral);
    ports.torque_command() = ports.inertia().cwiseProduct(lead(demand, dt));
    const Met met = command_rotors();

    const Vector3 position_error = ports.position_reference() - ports.position();
    const bool horizontal_met = attitude.within_limit && !attitude_mode();
    const bool position_met[] = {horizontal_met, horizontal_met, met.thrust && acceleration.within_limit};
    const bool rate_met[] = {met.roll_pitch, met.roll_pitch, met.yaw};
    for (int i = 0; i < 3; ++i) {
      integrate(position_integral[i], ports.position_integral_gain()[i] * position_error[i] * dt,
                ports.position_integral_limit()[i], position_met[i]);
      integrate(rate_integral[i], ports.rate_integral_gain()[i] * rate_error[i] * dt, ports.rate_integral_limit()[i],
                rate_met[i]);
    }
  }

  const char* parameter_error() const {
    if (!(ports.rotor_speed_min() < ports.rotor_speed_max())) return "rotor_speed_min must be below rotor_speed_max";
    if (!(std::fabs(allocation_matrix().rowwise().normalized().determinant()) > 1e-6)) {  // NaN if a row is 0
      return "rotor_x, rotor_y and rotor_direction leave no way to set thrust and three torques independently";
    }
    return nullptr;
  }

 private:
  using Vector3 = Eigen::Vector3d;
  using Rotors = Eigen::Array4d;
  static constexpr double kFullTurn = 6.283185307179586;  // rad

  struct Acceleration {
    Vector3 value;  // m/s2, NED
    bool within_limit;
  };
  struct Attitude {
    Vector3 euler;  // rad
    bool within_limit;
  };
  /// Which demands the rotor speed limits allow.
  struct Met {
    bool thrust, roll_pitch, yaw;
  };

  Eigen::Matrix4d allocation_matrix() const {
    Eigen::Matrix4d matrix;
    allocation(ports.vehicle_parameters(), matrix.data());
    return matrix;
  }

  bool attitude_mode() const { return ports.attitude_mode() > 0.5; }

  static double clamp(double value, double limit) { return std::fmin(std::fmax(value, -limit), limit); }

  /// PID on the position with feed-forward of acceleration and drag. The measured velocity comes 2/omega_0 late through
  /// filter (33); the reference it is compared with is delayed likewise, to first order.
  Acceleration acceleration_demand() {
    const Vector3 seen_reference =
        ports.velocity_reference() - 2.0 / ports.velocity_filter_bandwidth() * ports.acceleration_reference();
    Vector3 demand =
        ports.acceleration_reference() + ports.drag_coefficient() / ports.mass() * ports.velocity_reference() +
        ports.position_gain().cwiseProduct(ports.position_reference() - ports.position()) +
        ports.velocity_gain().cwiseProduct(seen_reference - ports.velocity()) + Vector3::Map(position_integral);
    const double vertical = demand.z();
    demand.z() = clamp(vertical, ports.vertical_acceleration_limit());
    return {demand, demand.z() == vertical};
  }

  /// Outer loop: roll and pitch that point the thrust along gravity minus the demanded acceleration, at the measured
  /// yaw angle. In attitude mode the references are flown as they are.
  Attitude attitude_demand(const Vector3& acceleration) const {
    const double yaw_reference = ports.euler_reference()[2];
    if (attitude_mode()) return {ports.euler_reference(), true};
    const double c = std::cos(ports.euler()[2]), s = std::sin(ports.euler()[2]);
    const double forward = c * acceleration.x() + s * acceleration.y();
    const double right = c * acceleration.y() - s * acceleration.x();
    const double down = std::fmax(ports.gravity() - acceleration.z(), 0.1 * ports.gravity());
    const double roll = std::atan2(right, std::sqrt(forward * forward + down * down)),
                 pitch = std::atan2(-forward, down);
    const double limit = ports.tilt_limit();
    return {{clamp(roll, limit), clamp(pitch, limit), yaw_reference},
            std::fabs(roll) <= limit && std::fabs(pitch) <= limit};
  }

  /// Body rates that turn the Euler angles towards the demand, inverse of (3).
  Vector3 rate_demand(const Vector3& euler_command) const {
    Vector3 error = euler_command - ports.euler();
    error.z() = std::remainder(error.z(), kFullTurn);
    Vector3 euler_rate = ports.attitude_gain().cwiseProduct(error);
    euler_rate.z() += ports.yaw_rate_reference();
    const double roll = ports.euler()[0], pitch = ports.euler()[1];
    const double turning = std::cos(pitch) * euler_rate.z();
    return {euler_rate.x() - std::sin(pitch) * euler_rate.z(),
            std::cos(roll) * euler_rate.y() + std::sin(roll) * turning,
            std::cos(roll) * turning - std::sin(roll) * euler_rate.y()};
  }

  Vector3 filter_rate(double dt) {
    auto rate = Vector3::Map(filtered_rate);
    rate += (1.0 - std::exp(-ports.gyro_filter_bandwidth() * dt)) * (ports.body_rate() - rate);
    return rate;
  }

  /// (tau s + 1) / (tau s / ratio + 1): makes the motor lag tau seem shorter by the ratio, and the noise larger.
  Vector3 lead(const Vector3& demand, double dt) {
    const double ratio = ports.motor_lag_lead();
    auto lagged = Vector3::Map(lagged_demand);
    lagged += (1.0 - std::exp(-ratio * dt / ports.motor_time_constant())) * (demand - lagged);
    return ratio * demand - (ratio - 1.0) * lagged;
  }

  /// Squared rotor speeds by the inverse of the allocation matrix. Where the limits do not allow all of it: thrust is
  /// served first, then as much roll and pitch torque as fits (its direction is kept), then as much yaw torque.
  Met command_rotors() {
    const auto inverse = Eigen::Matrix4d::Map(inverse_allocation);
    const Rotors least = Rotors::Constant(ports.rotor_speed_min() * ports.rotor_speed_min());
    const Rotors most = Rotors::Constant(ports.rotor_speed_max() * ports.rotor_speed_max());
    const Rotors thrust = inverse.col(0) * ports.thrust_command();
    const Rotors roll_pitch = inverse.middleCols<2>(1) * ports.torque_command().head<2>();
    const Rotors yaw = inverse.col(3) * ports.torque_command()[2];

    Rotors squared_speed = thrust.max(least).min(most);
    const bool thrust_met = (squared_speed == thrust).all();
    const double roll_pitch_share = share(roll_pitch, squared_speed - least, most - squared_speed);
    squared_speed += roll_pitch_share * roll_pitch;
    const double yaw_share = share(yaw, squared_speed - least, most - squared_speed);
    squared_speed += yaw_share * yaw;
    ports.rotor_speed_command() =
        squared_speed.max(least).min(most).sqrt();  // rounding may have carried a share over a limit
    return {thrust_met, roll_pitch_share == 1.0, yaw_share == 1.0};
  }

  /// Largest factor up to 1 by which `increment` fits into the room below and above.
  static double share(const Rotors& increment, const Rotors& room_below, const Rotors& room_above) {
    double largest = 1.0;
    for (int i = 0; i < 4; ++i) {
      const double room = increment[i] > 0.0 ? room_above[i] : room_below[i];
      if (std::fabs(increment[i]) > room) largest = std::fmin(largest, room / std::fabs(increment[i]));
    }
    return largest;
  }

  /// Anti-windup: while a demand is not met its integral may only shrink, and it is limited in any case.
  static void integrate(double& integral, double increment, double limit, bool met) {
    if (met || integral * increment < 0.0) integral = clamp(integral + increment, limit);
  }
};

}  // namespace rotordx

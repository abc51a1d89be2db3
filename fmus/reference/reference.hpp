// The trajectory to be flown, as a function of time alone.
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "reference_ports.hpp"

namespace rotordx {

/// Equations and port table: README.md.
struct Model {
  static constexpr int kWaypoints = 16;

  Ports ports;
  double departure[kWaypoints], duration[kWaypoints];  // s, of the legs between way-points

  void initialise(double start_time) {
    plan_waypoints();
    evaluate(start_time);
  }

  void step(double time, double dt) { evaluate(time + dt); }

  const char* parameter_error() const {
    const double count = ports.waypoint_count();
    return count == std::floor(count) ? nullptr : "waypoint_count must be a whole number";
  }

 private:
  using Vector3 = Eigen::Vector3d;
  using Trajectory = Ports::Trajectory;
  static constexpr double kFullTurn = 6.283185307179586;  // rad

  /// A quantity and its first two derivatives with respect to its argument.
  struct Jet {
    double value, first, second;
  };

  /// A point of the trajectory; derivatives with respect to the progress along it.
  struct Point {
    Vector3 position, velocity = Vector3::Zero(), acceleration = Vector3::Zero();
    double roll = 0.0, yaw = 0.0, yaw_rate = 0.0;
  };

  Trajectory trajectory() const { return static_cast<Trajectory>(ports.trajectory()); }

  void evaluate(double time) {
    const Jet s = progress(time);
    const Point point = trajectory_point(s.value);
    ports.position_reference() = point.position;
    ports.velocity_reference() = point.velocity * s.first;
    ports.acceleration_reference() = point.acceleration * (s.first * s.first) + point.velocity * s.second;
    ports.euler_reference() << point.roll, 0.0, point.yaw;
    ports.yaw_rate_reference() = point.yaw_rate * s.first;
    ports.attitude_mode() = trajectory() == Trajectory::kRollSine;
  }

  /// Progress s along the trajectory, in seconds: ds/dt rises from 0 to 1 as the cubic 3u^2 - 2u^3 over ramp_time.
  Jet progress(double time) const {
    const double elapsed = time - ports.start_time(), ramp = ports.ramp_time();
    if (elapsed < 0.0) return {0.0, 0.0, 0.0};
    if (elapsed >= ramp) return {elapsed - 0.5 * ramp, 1.0, 0.0};
    const double u = elapsed / ramp;
    return {ramp * u * u * u * (1.0 - 0.5 * u), u * u * (3.0 - 2.0 * u), 6.0 * u * (1.0 - u) / ramp};
  }

  Point trajectory_point(double s) const {
    switch (trajectory()) {
      case Trajectory::kCircle:
        return ellipse(s, ports.radius(), ports.radius());
      case Trajectory::kEllipse:
        return ellipse(s, ports.radius(), ports.radius_y());
      case Trajectory::kWaypoints:
        return between_waypoints(s);
      case Trajectory::kVerticalSine: {
        Point point = hover();
        const Jet z = sine(s, ports.vertical_amplitude(), ports.angular_rate());
        point.position.z() += z.value;
        point.velocity.z() = z.first;
        point.acceleration.z() = z.second;
        return point;
      }
      case Trajectory::kRollSine: {
        Point point = hover();
        point.roll = sine(s, ports.roll_amplitude(), ports.angular_rate()).value;
        return point;
      }
      case Trajectory::kHover:
        break;
    }
    return hover();
  }

  static Jet sine(double s, double amplitude, double rate) {
    const double value = amplitude * std::sin(rate * s);
    return {value, amplitude * rate * std::cos(rate * s), -rate * rate * value};
  }

  Point hover() const {
    Point point;
    point.position = ports.centre();
    point.yaw = ports.heading();
    return point;
  }

  Point ellipse(double s, double semi_axis_x, double semi_axis_y) const {
    const double rate = ports.angular_rate(), c = std::cos(rate * s), n = std::sin(rate * s);
    const Jet yaw = sine(s, ports.yaw_amplitude(), kFullTurn / ports.yaw_period());
    Point point = hover();
    point.position += Vector3(semi_axis_x * c, semi_axis_y * n, 0.0);
    point.velocity << -semi_axis_x * rate * n, semi_axis_y * rate * c, 0.0;
    point.acceleration << -semi_axis_x * rate * rate * c, -semi_axis_y * rate * rate * n, 0.0;
    point.yaw += yaw.value;
    point.yaw_rate = yaw.first;
    return point;
  }

  Vector3 waypoint(int i) const { return {ports.waypoint_x()[i], ports.waypoint_y()[i], ports.waypoint_z()[i]}; }

  /// Departures and durations of the legs: the quintic rest-to-rest motion 10u^3 - 15u^4 + 6u^5 has the largest speed
  /// 15/8 and the largest acceleration 10/sqrt(3), both per unit of distance and duration.
  void plan_waypoints() {
    double time = 0.0;
    for (int leg = 0; leg + 1 < ports.waypoint_count(); ++leg) {
      const double distance = (waypoint(leg + 1) - waypoint(leg)).norm();
      const double turn = std::fabs(ports.waypoint_yaw()[leg + 1] - ports.waypoint_yaw()[leg]);
      departure[leg] = time + ports.waypoint_hold();
      duration[leg] = std::fmax(15.0 / 8.0 * distance / ports.speed_limit(),
                                std::fmax(std::sqrt(10.0 / std::sqrt(3.0) * distance / ports.acceleration_limit()),
                                          15.0 / 8.0 * turn / ports.yaw_rate_limit()));
      time = departure[leg] + duration[leg];
    }
  }

  Point between_waypoints(double s) const {
    int leg = 0;
    while (leg + 1 < ports.waypoint_count() && s >= departure[leg] + duration[leg]) ++leg;
    Point point;
    point.position = waypoint(leg);
    point.yaw = ports.waypoint_yaw()[leg];
    if (leg + 1 < ports.waypoint_count() && s > departure[leg]) {
      const double u = (s - departure[leg]) / duration[leg];
      const double covered = u * u * u * (10.0 + u * (6.0 * u - 15.0));
      const double speed = 30.0 * u * u * (1.0 - u) * (1.0 - u) / duration[leg];
      const double turn = ports.waypoint_yaw()[leg + 1] - ports.waypoint_yaw()[leg];
      const Vector3 way = waypoint(leg + 1) - waypoint(leg);
      point.position += covered * way;
      point.velocity = speed * way;
      point.acceleration = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (duration[leg] * duration[leg]) * way;
      point.yaw += covered * turn;
      point.yaw_rate = speed * turn;
    }
    return point;
  }
};

}  // namespace rotordx

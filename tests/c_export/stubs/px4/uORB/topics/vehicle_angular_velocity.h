#pragma once
#include <cstdint>
struct vehicle_angular_velocity_s {
  uint64_t timestamp;
  float xyz[3];
};

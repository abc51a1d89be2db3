#pragma once
#include <cstdint>
struct vehicle_attitude_s {
  uint64_t timestamp;
  float q[4];
};

#pragma once
#include <cstdint>
struct vehicle_local_position_s {
  uint64_t timestamp;
  float vz;
};

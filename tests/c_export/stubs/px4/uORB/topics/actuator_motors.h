#pragma once
#include <cstdint>
struct actuator_motors_s {
  uint64_t timestamp;
  float control[12];
};

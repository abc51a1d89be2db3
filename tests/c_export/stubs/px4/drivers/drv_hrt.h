#pragma once
#include <cstdint>
uint64_t hrt_absolute_time();

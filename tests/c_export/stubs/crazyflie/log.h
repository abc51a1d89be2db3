#pragma once
#include <stdint.h>
typedef uint16_t logVarId_t;
logVarId_t logGetVarId(const char* group, const char* name);
float logGetFloat(logVarId_t variable);
int logGetInt(logVarId_t variable);
unsigned int logGetUint(logVarId_t variable);

enum { LOG_UINT8 = 1, LOG_INT8 = 4, LOG_FLOAT = 7 };
struct log_s {
  uint8_t type;
  const char* name;
  void* address;
};
#define LOG_GROUP_START(NAME)              \
  extern const struct log_s logs_##NAME[]; \
  const struct log_s logs_##NAME[] = {
#define LOG_ADD(TYPE, NAME, ADDRESS) {.type = TYPE, .name = #NAME, .address = (void*)(ADDRESS)},
#define LOG_GROUP_STOP(NAME) {.type = 0, .name = 0, .address = 0}} \
  ;

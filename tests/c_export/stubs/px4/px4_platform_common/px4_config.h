#pragma once
#define __EXPORT __attribute__((visibility("default")))
#define PX4_OK 0
#define PX4_ERROR (-1)
#define PX4_WARN(...) ((void)0)

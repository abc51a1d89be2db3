// As much of the Crazyflie firmware as the wrapper uses.
#pragma once
void appMain(void);
#define M2T(milliseconds) ((TickType_t)(milliseconds))

#pragma once
#include <stddef.h>

#include "FreeRTOS.h"
typedef struct tskTaskControlBlock* TaskHandle_t;
TickType_t xTaskGetTickCount(void);
void vTaskDelayUntil(TickType_t* previous, TickType_t increment);
void vTaskDelete(TaskHandle_t task);

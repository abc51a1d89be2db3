#pragma once
#include "FreeRTOS.h"
typedef struct QueueDefinition* QueueHandle_t;
BaseType_t xQueueReceive(QueueHandle_t queue, void* item, TickType_t wait);
BaseType_t xQueueOverwrite(QueueHandle_t queue, const void* item);

#pragma once
#include "FreeRTOS.h"
TickType_t xTaskGetTickCount(void);
void vTaskDelayUntil(TickType_t *previous, TickType_t period);
#define taskENTER_CRITICAL()
#define taskEXIT_CRITICAL()

/* What the app uses of FreeRTOS and of the Crazyflie's firmware, declared alike, to compile it here. */
#pragma once
#include <stdint.h>
typedef uint32_t TickType_t;
#define M2T(ms) ((TickType_t)(ms))

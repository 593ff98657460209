#pragma once
#include <stdint.h>
typedef uint16_t logVarId_t;
logVarId_t logGetVarId(const char *group, const char *name);
float logGetFloat(logVarId_t id);
enum { LOG_UINT8 = 1, LOG_FLOAT = 7 };
struct log_entry {
    uint8_t type;
    const char *name;
    void *address;
};
#define LOG_GROUP_START(NAME) extern const struct log_entry log_##NAME[]; const struct log_entry log_##NAME[] = {
#define LOG_ADD(TYPE, NAME, ADDRESS) {TYPE, #NAME, ADDRESS},
#define LOG_GROUP_STOP(NAME) };

#pragma once
#include <stdint.h>
enum { PARAM_FLOAT = 6 };
struct param_entry {
    uint8_t type;
    const char *name;
    void *address;
};
#define PARAM_GROUP_START(NAME) extern const struct param_entry param_##NAME[]; const struct param_entry param_##NAME[] = {
#define PARAM_ADD(TYPE, NAME, ADDRESS) {TYPE, #NAME, ADDRESS},
#define PARAM_GROUP_STOP(NAME) };

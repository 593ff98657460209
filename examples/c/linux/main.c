/* Reads one observation a line from standard input, in the order and the units of wake.h, and
   prints the force. A line "reset" forgets the past. Lines before the memory is full are marked with "#". */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "wake.h"

/* The numbers of a line; 0 where it does not hold exactly as many as there are inputs. */
static int parsed(const char *line, float observation[WAKE_INPUTS])
{
    char *rest;
    for (int i = 0; i < WAKE_INPUTS; ++i) {
        observation[i] = strtof(line, &rest);
        if (rest == line) {
            return 0;
        }
        line = rest;
    }
    return strspn(line, " \t\r\n") == strlen(line);
}

int main(void)
{
    static wake_state state;
    static char line[4096];
    float observation[WAKE_INPUTS], force[WAKE_OUTPUTS];
    long number = 0, seen = 0;

    wake_reset(&state);
    while (fgets(line, sizeof line, stdin) != NULL) {
        ++number;
        if (strncmp(line, "reset", 5) == 0) {
            wake_reset(&state);
            seen = 0;
            continue;
        }
        if (!parsed(line, observation)) {
            fprintf(stderr, "line %ld: not %d numbers\n", number, WAKE_INPUTS);
            return 2;
        }
        wake_step(&state, observation, force);
        ++seen;
        printf("%s", seen < WAKE_WARM_UP_STEPS ? "# " : "");
        for (int i = 0; i < WAKE_OUTPUTS; ++i) {
            printf("%.9g%c", (double)force[i], i + 1 < WAKE_OUTPUTS ? ' ' : '\n');
        }
    }
    return 0;
}

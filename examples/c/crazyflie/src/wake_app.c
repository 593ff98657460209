/* Predicts the push of a neighbour's downwash, on the Crazyflie itself.

   A neighbour broadcasts its state and command over the radio, peer to peer, at the package's rate. This
   app relates it to its own state, steps the predictor and shows the force as log variables wake.fx,
   wake.fy and wake.fz, in newtons and world axes. What a controller does with it is not decided here.

   It is for a package of the domain crazyflie: `wakedeploy data import crazyflie`, `train`, and
   `export --c FOLDER --name wake`; copy wake.c and wake.h into src/. The app's stack has to hold what
   README.md of that folder says a step takes. */
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "FreeRTOS.h"
#include "app.h"
#include "log.h"
#include "param.h"
#include "radiolink.h"
#include "task.h"

#include "wake.h"

#define INPUTS 12 /* of the domain crazyflie, in this order: d[3], dv[3], commands, batteries, masses */
#define OUTPUTS 3
#define SILENT_MS 200 /* after which a neighbour is no longer there */
#define FULL_COMMAND 65535.0f

typedef char package_is_for_the_crazyflie[WAKE_INPUTS == INPUTS && WAKE_OUTPUTS == OUTPUTS ? 1 : -1];

/* What a neighbour sends. SI units, world axes. */
typedef struct {
    float position[3];
    float velocity[3];
    float command; /* mean of its motors', 0 to 1 */
    float battery_v;
    float mass_kg;
} __attribute__((packed)) neighbour_t;

static neighbour_t heard;
static volatile uint32_t heard_at;
static volatile bool has_heard;

static wake_state state;
static float force[OUTPUTS];
static uint8_t is_ready;
static float own_mass_kg = 0.032f;

/* From the radio's task: a packet of the right size is a neighbour's. */
static void on_packet(P2PPacket *packet)
{
    if (packet->size == sizeof(neighbour_t)) {
        memcpy(&heard, packet->data, sizeof heard);
        heard_at = xTaskGetTickCount();
        has_heard = true;
    }
}

static float mean_command(logVarId_t motors[4])
{
    float sum = 0.0f;
    for (int i = 0; i < 4; ++i) {
        sum += logGetFloat(motors[i]);
    }
    return sum / (4.0f * FULL_COMMAND);
}

static void observe(const neighbour_t *neighbour, const neighbour_t *own, float observation[INPUTS])
{
    for (int i = 0; i < 3; ++i) {
        observation[i] = neighbour->position[i] - own->position[i];
        observation[3 + i] = neighbour->velocity[i] - own->velocity[i];
    }
    observation[6] = neighbour->command;
    observation[7] = own->command;
    observation[8] = neighbour->battery_v;
    observation[9] = own->battery_v;
    observation[10] = neighbour->mass_kg;
    observation[11] = own->mass_kg;
}

static void send(const neighbour_t *own)
{
    static P2PPacket packet;
    packet.port = 0;
    packet.size = sizeof *own;
    memcpy(packet.data, own, sizeof *own);
    radiolinkSendP2PPacketBroadcast(&packet);
}

void appMain(void)
{
    const TickType_t period = M2T((uint32_t)(1000.0f / WAKE_RATE_HZ));
    logVarId_t place[3] = {logGetVarId("stateEstimate", "x"), logGetVarId("stateEstimate", "y"),
                           logGetVarId("stateEstimate", "z")};
    logVarId_t speed[3] = {logGetVarId("stateEstimate", "vx"), logGetVarId("stateEstimate", "vy"),
                           logGetVarId("stateEstimate", "vz")};
    logVarId_t motors[4] = {logGetVarId("motor", "m1"), logGetVarId("motor", "m2"),
                            logGetVarId("motor", "m3"), logGetVarId("motor", "m4")};
    logVarId_t battery = logGetVarId("pm", "vbat");
    TickType_t next = xTaskGetTickCount();
    uint32_t steps = 0;

    p2pRegisterCB(on_packet);
    wake_reset(&state);
    for (;;) {
        neighbour_t own, other;
        float observation[INPUTS];

        vTaskDelayUntil(&next, period);
        for (int i = 0; i < 3; ++i) {
            own.position[i] = logGetFloat(place[i]);
            own.velocity[i] = logGetFloat(speed[i]);
        }
        own.command = mean_command(motors);
        own.battery_v = logGetFloat(battery);
        own.mass_kg = own_mass_kg;
        send(&own);

        taskENTER_CRITICAL();
        other = heard;
        taskEXIT_CRITICAL();
        if (!has_heard || xTaskGetTickCount() - heard_at > M2T(SILENT_MS)) {
            wake_reset(&state); /* nobody there: its past is worth nothing later */
            steps = 0;
            memset(force, 0, sizeof force);
            is_ready = 0;
            continue;
        }
        observe(&other, &own, observation);
        wake_step(&state, observation, force);
        steps = steps < WAKE_WARM_UP_STEPS ? steps + 1 : steps;
        is_ready = steps >= WAKE_WARM_UP_STEPS;
    }
}

LOG_GROUP_START(wake)
LOG_ADD(LOG_FLOAT, fx, &force[0])
LOG_ADD(LOG_FLOAT, fy, &force[1])
LOG_ADD(LOG_FLOAT, fz, &force[2])
LOG_ADD(LOG_UINT8, ready, &is_ready)
LOG_GROUP_STOP(wake)

PARAM_GROUP_START(wake)
PARAM_ADD(PARAM_FLOAT, mass, &own_mass_kg)
PARAM_GROUP_STOP(wake)

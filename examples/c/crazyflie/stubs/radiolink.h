#pragma once
#include <stdbool.h>
#include <stdint.h>
#define P2P_MAX_DATA_SIZE 60
typedef struct {
    uint8_t size;
    uint8_t rssi;
    uint8_t port;
    uint8_t data[P2P_MAX_DATA_SIZE];
} __attribute__((packed)) P2PPacket;
typedef void (*P2PCallback)(P2PPacket *);
void p2pRegisterCB(P2PCallback callback);
bool radiolinkSendP2PPacketBroadcast(P2PPacket *packet);

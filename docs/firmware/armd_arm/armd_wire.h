// armd's serial wire, version 1, for a microcontroller: docs/reference/wire.md. Plain C99, no heap, no
// library. Copyright: as armd, Apache-2.0.
#ifndef ARMD_WIRE_H
#define ARMD_WIRE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define ARMD_PROTOCOL 1
#define ARMD_MAX_JOINTS 9
#define ARMD_MAX_SENSORS 16
// The longest body is SAMPLE's with 9 joints: 16 + 36 bytes; then CRC, COBS's code and the zero.
#define ARMD_BODY_MAX 64
#define ARMD_PACKET_MAX (ARMD_BODY_MAX + 4 + 2)

enum {
  ARMD_SAMPLE = 0x01,
  ARMD_TEMPERATURE = 0x02,
  ARMD_HELLO = 0x03,
  ARMD_PONG = 0x04,
  ARMD_IDENTIFY = 0x81,
  ARMD_PING = 0x82
};

// CRC-32 as in zlib and PNG.
static inline uint32_t armd_crc32(const uint8_t *data, size_t n) {
  uint32_t crc = 0xFFFFFFFFu;
  for (size_t i = 0; i < n; i++) {
    crc ^= data[i];
    for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ ((crc & 1u) ? 0xEDB88320u : 0u);
  }
  return ~crc;
}

static inline uint8_t *armd_put(uint8_t *at, uint64_t value, int bytes) {
  for (int i = 0; i < bytes; i++) *at++ = (uint8_t)(value >> (8 * i));
  return at;
}

static inline uint32_t armd_u32(const uint8_t *at) {
  return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

// COBS(body, CRC) and the closing zero into packet[ARMD_PACKET_MAX]; its length. *body* has room
// for four bytes behind its n. No body here is longer than 250, so that no run of COBS overflows.
static inline size_t armd_pack(uint8_t *body, size_t n, uint8_t *packet) {
  armd_put(body + n, armd_crc32(body, n), 4);
  n += 4;
  size_t code_at = 0, out = 1;
  for (size_t i = 0; i < n; i++) {
    if (body[i]) {
      packet[out++] = body[i];
    } else {
      packet[code_at] = (uint8_t)(out - code_at);
      code_at = out++;
    }
  }
  packet[code_at] = (uint8_t)(out - code_at);
  packet[out++] = 0;
  return out;
}

// joint_status: bit k-1 set where joint k must not be believed. t_us: the latch, since boot.
static inline size_t armd_sample(uint8_t *packet, uint8_t joint_status, uint8_t buttons,
                                 uint32_t seq, uint64_t t_us, const uint32_t *counts, uint8_t n) {
  uint8_t body[ARMD_BODY_MAX + 4], *at = body;
  *at++ = ARMD_SAMPLE;
  *at++ = joint_status;
  *at++ = buttons;
  *at++ = n;
  at = armd_put(at, seq, 4);
  at = armd_put(at, t_us, 8);
  for (uint8_t k = 0; k < n; k++) at = armd_put(at, counts[k], 4);
  return armd_pack(body, (size_t)(at - body), packet);
}

// valid: bit i set where channel i holds; centi_celsius in 0.01 degrees Celsius.
static inline size_t armd_temperature(uint8_t *packet, uint16_t valid, uint64_t t_us,
                                      const int16_t *centi_celsius, uint8_t n) {
  uint8_t body[ARMD_BODY_MAX + 4], *at = body;
  *at++ = ARMD_TEMPERATURE;
  *at++ = n;
  at = armd_put(at, valid, 2);
  at = armd_put(at, t_us, 8);
  for (uint8_t i = 0; i < n; i++) at = armd_put(at, (uint16_t)centi_celsius[i], 2);
  return armd_pack(body, (size_t)(at - body), packet);
}

// serial: up to 16 ASCII characters. bits[k]: joint k+1 counts modulo 2^bits.
static inline size_t armd_hello(uint8_t *packet, uint8_t joints, uint8_t sensors, uint16_t rate_hz,
                                uint32_t boot_id, const char *serial, const uint8_t *bits) {
  uint8_t body[ARMD_BODY_MAX + 4], *at = body;
  *at++ = ARMD_HELLO;
  *at++ = ARMD_PROTOCOL;
  *at++ = joints;
  *at++ = sensors;
  at = armd_put(at, rate_hz, 2);
  at = armd_put(at, boot_id, 4);
  size_t length = strlen(serial);
  memset(at, 0, 16);
  memcpy(at, serial, length < 16 ? length : 16);
  at += 16;
  memcpy(at, bits, joints);
  return armd_pack(body, (size_t)(at - body) + joints, packet);
}

static inline size_t armd_pong(uint8_t *packet, uint32_t nonce, uint64_t t_us) {
  uint8_t body[ARMD_BODY_MAX + 4], *at = body;
  *at++ = ARMD_PONG;
  at = armd_put(at, nonce, 4);
  at = armd_put(at, t_us, 8);
  return armd_pack(body, (size_t)(at - body), packet);
}

// What the host says, byte by byte: zero-initialise one of these.
typedef struct {
  uint8_t bytes[16];  // IDENTIFY takes 7 of them, PING 11
  uint8_t n;
} armd_listener;

// The type of the message that *byte* completes, or 0; *nonce* is a PING's.
static inline uint8_t armd_hear(armd_listener *ear, uint8_t byte, uint32_t *nonce) {
  if (byte) {
    if (ear->n < sizeof ear->bytes) ear->bytes[ear->n] = byte;
    if (ear->n < 255) ear->n++;
    return 0;
  }
  uint8_t n = ear->n, body[sizeof ear->bytes], length = 0, i = 0;
  ear->n = 0;
  if (n < 6 || n > sizeof ear->bytes) return 0;
  while (i < n) {  // COBS
    uint8_t code = ear->bytes[i++];
    if (i + code - 1 > n) return 0;
    for (uint8_t j = 1; j < code; j++) body[length++] = ear->bytes[i++];
    if (i < n) body[length++] = 0;
  }
  length -= 4;
  if (armd_crc32(body, length) != armd_u32(body + length)) return 0;
  if (body[0] == ARMD_IDENTIFY && length == 1) return ARMD_IDENTIFY;
  if (body[0] != ARMD_PING || length != 5) return 0;
  *nonce = armd_u32(body + 1);
  return ARMD_PING;
}

#endif

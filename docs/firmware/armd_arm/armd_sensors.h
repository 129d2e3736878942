// What three magnetic encoders and a thermistor say, without a pin or a clock. Plain C99,
// Apache-2.0 as armd.
#ifndef ARMD_SENSORS_H
#define ARMD_SENSORS_H

#include <math.h>
#include <stdint.h>

#define AS5600_BITS 12
#define AS5047_BITS 14
#define MT6701_BITS 14

// AS5600, I2C address 0x36: registers 0x0B (status), 0x0C, 0x0D (raw angle). Bit 5 of the status
// is "magnet detected". Returns whether *count* is to be believed.
static inline int as5600_decode(const uint8_t registers[3], uint32_t *count) {
  *count = (uint32_t)(registers[1] & 0x0F) << 8 | registers[2];
  return (registers[0] & 0x20) != 0;
}

// AS5047P/D: 16 bits, most significant first, SPI mode 1. Bit 15 makes the parity even, bit 14
// tells of an error in the command before. 0xFFFF reads ANGLECOM; its answer comes with the next
// word.
#define AS5047_READ_ANGLE 0xFFFFu
static inline int as5047_decode(uint16_t word, uint32_t *count) {
  uint16_t parity = word;
  for (int shift = 8; shift; shift >>= 1) parity ^= parity >> shift;
  *count = word & 0x3FFFu;
  return !(parity & 1u) && !(word & 0x4000u);
}

// MT6701, SSI: 24 bits, most significant first: 14 of angle, 4 of status, CRC-6 (x^6 + x + 1) of
// these 18. Status bits 0-1: field too strong, too weak; bit 3: it cannot follow the speed.
static inline int mt6701_decode(uint32_t frame, uint32_t *count) {
  uint32_t data = frame >> 6 & 0x3FFFFu, crc = 0;
  for (int bit = 17; bit >= 0; bit--) {
    crc = crc << 1 ^ (((crc >> 5 ^ data >> bit) & 1u) ? 0x03u : 0u);
    crc &= 0x3Fu;
  }
  *count = data >> 4;
  return crc == (frame & 0x3Fu) && !(data & 0x0Bu);
}

// A 10 kOhm NTC (beta 3950 K, 25 degrees) to ground, with a resistor of *series_ohm* to the
// converter's reference; *reading* of 0 ... *full*. Returns whether a sensor is there at all.
static inline int ntc_decode(uint32_t reading, uint32_t full, double series_ohm, double beta_k,
                             int16_t *centi_celsius) {
  *centi_celsius = 0;
  if (reading * 100ull < full || reading * 100ull > 99ull * full) return 0;  // shorted, open
  double ohm = series_ohm * reading / (double)(full - reading);
  double kelvin = 1.0 / (1.0 / 298.15 + log(ohm / 10000.0) / beta_k);
  double centi = (kelvin - 273.15) * 100.0;
  if (centi < -4000.0 || centi > 15000.0) return 0;
  *centi_celsius = (int16_t)lround(centi);
  return 1;
}

#endif

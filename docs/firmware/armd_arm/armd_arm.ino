// A measuring arm of your own: magnetic encoders and thermistors on a microcontroller, speaking
// armd's serial wire. Choose the encoder, set the pins, give it a name. docs/how-to/firmware.md.
//
// For boards with a fast USB serial port or a 2 Mbaud UART: Teensy, RP2040, ESP32, STM32.
#include <SPI.h>
#include <Wire.h>

#include "armd_sensors.h"
#include "armd_wire.h"

#define ENCODER_AS5600 1  // I2C through a TCA9548A; one reading takes about 0.2 ms
#define ENCODER_AS5047 2  // SPI
#define ENCODER_MT6701 3  // SSI, read as SPI
#define ENCODER ENCODER_AS5047

static const char SERIAL_NUMBER[] = "MY-ARM-1";  // as in arm.toml; at most 16 characters
static const uint16_t RATE_HZ = 500;
static const uint8_t JOINTS = 6;
static const uint8_t SENSORS = 6;
static const uint8_t CHIP_SELECT[JOINTS] = {2, 3, 4, 5, 6, 7};  // of SPI encoders
static const uint8_t NTC_PIN[SENSORS] = {A0, A1, A2, A3, A4, A5};
static const uint8_t BUTTON_PIN[2] = {8, 9};  // to ground
static const uint32_t ADC_FULL = 4095;
static const double SERIES_OHM = 10000.0, BETA_K = 3950.0;
static const uint8_t MUX_ADDRESS = 0x70, AS5600_ADDRESS = 0x36;

static uint8_t packet[ARMD_PACKET_MAX];
static armd_listener ear;
static uint32_t seq, boot_id, next_us, next_temperature_us;

// Microseconds since boot; micros() wraps every 71 minutes and is asked far more often.
static uint64_t now_us() {
  static uint32_t last, turns;
  uint32_t now = micros();
  if (now < last) turns++;
  last = now;
  return (uint64_t)turns << 32 | now;
}

static void send(size_t n) {
  // A host that does not read must not hold up the latches: what finds no room is dropped whole,
  // and seq tells.
  if ((size_t)Serial.availableForWrite() >= n) Serial.write(packet, n);
}

static bool read_encoder(uint8_t k, uint32_t *count) {
#if ENCODER == ENCODER_AS5600
  uint8_t registers[3] = {0, 0, 0};
  Wire.beginTransmission(MUX_ADDRESS);
  Wire.write((uint8_t)(1u << k));
  if (Wire.endTransmission() != 0) return false;
  Wire.beginTransmission(AS5600_ADDRESS);
  Wire.write((uint8_t)0x0B);
  if (Wire.endTransmission(false) != 0) return false;
  if (Wire.requestFrom(AS5600_ADDRESS, (uint8_t)3) != 3) return false;
  for (uint8_t i = 0; i < 3; i++) registers[i] = (uint8_t)Wire.read();
  return as5600_decode(registers, count);
#elif ENCODER == ENCODER_AS5047
  // Asked twice: a word answers the one before it.
  uint16_t word = 0;
  for (uint8_t i = 0; i < 2; i++) {
    SPI.beginTransaction(SPISettings(8000000, MSBFIRST, SPI_MODE1));
    digitalWrite(CHIP_SELECT[k], LOW);
    word = SPI.transfer16(AS5047_READ_ANGLE);
    digitalWrite(CHIP_SELECT[k], HIGH);
    SPI.endTransaction();
  }
  return as5047_decode(word, count);
#else
  uint32_t frame = 0;
  SPI.beginTransaction(SPISettings(4000000, MSBFIRST, SPI_MODE2));
  digitalWrite(CHIP_SELECT[k], LOW);
  for (uint8_t i = 0; i < 3; i++) frame = frame << 8 | SPI.transfer(0);
  digitalWrite(CHIP_SELECT[k], HIGH);
  SPI.endTransaction();
  return mt6701_decode(frame, count);
#endif
}

static uint8_t encoder_bits() {
  return ENCODER == ENCODER_AS5600 ? AS5600_BITS : ENCODER == ENCODER_AS5047 ? AS5047_BITS
                                                                            : MT6701_BITS;
}

static void say_hello() {
  uint8_t bits[JOINTS];
  memset(bits, encoder_bits(), JOINTS);
  send(armd_hello(packet, JOINTS, SENSORS, RATE_HZ, boot_id, SERIAL_NUMBER, bits));
}

static void send_sample() {
  uint32_t counts[JOINTS] = {0};
  uint8_t status = 0, buttons = 0;
  uint64_t begin = now_us();
  for (uint8_t k = 0; k < JOINTS; k++)
    if (!read_encoder(k, &counts[k])) status |= (uint8_t)(1u << k);
  uint64_t t_us = begin + (now_us() - begin) / 2;  // the middle: joints are read one by one
  for (uint8_t i = 0; i < 2; i++)
    if (digitalRead(BUTTON_PIN[i]) == LOW) buttons |= (uint8_t)(1u << i);
  send(armd_sample(packet, status, buttons, seq++, t_us, counts, JOINTS));
}

static void send_temperatures() {
  int16_t centi[SENSORS];
  uint16_t valid = 0;
  for (uint8_t i = 0; i < SENSORS; i++) {
    uint32_t sum = 0;
    for (uint8_t j = 0; j < 16; j++) sum += (uint32_t)analogRead(NTC_PIN[i]);
    if (ntc_decode(sum, 16 * ADC_FULL, SERIES_OHM, BETA_K, &centi[i])) valid |= (uint16_t)(1u << i);
  }
  send(armd_temperature(packet, valid, now_us(), centi, SENSORS));
}

static void listen() {
  while (Serial.available() > 0) {
    uint32_t nonce = 0;
    switch (armd_hear(&ear, (uint8_t)Serial.read(), &nonce)) {
      case ARMD_IDENTIFY:
        say_hello();
        break;
      case ARMD_PING:  // stamped as it is made: the host's clock rests on it
        send(armd_pong(packet, nonce, now_us()));
        break;
    }
  }
}

void setup() {
  Serial.begin(2000000);
  Wire.begin();
  Wire.setClock(400000);
  SPI.begin();
  for (uint8_t k = 0; k < JOINTS; k++) {
    pinMode(CHIP_SELECT[k], OUTPUT);
    digitalWrite(CHIP_SELECT[k], HIGH);
  }
  for (uint8_t i = 0; i < 2; i++) pinMode(BUTTON_PIN[i], INPUT_PULLUP);
  // Another number at each boot: noise of an analog pin, stirred.
  for (uint8_t i = 0; i < 32; i++)
    boot_id = (boot_id << 1 | boot_id >> 31) ^ (uint32_t)analogRead(NTC_PIN[0]) ^ micros();
  say_hello();
  next_us = next_temperature_us = micros();
}

void loop() {
  listen();
  uint32_t now = micros();
  if ((int32_t)(now - next_us) >= 0) {
    next_us += 1000000ul / RATE_HZ;
    send_sample();
  } else if ((int32_t)(now - next_temperature_us) >= 0) {
    next_temperature_us += 500000ul;
    send_temperatures();
  }
}

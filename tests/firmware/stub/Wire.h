#pragma once
#include "Arduino.h"
struct WireClass {
  void begin(), setClock(uint32_t), beginTransmission(uint8_t);
  size_t write(uint8_t);
  uint8_t endTransmission(bool stop = true), requestFrom(uint8_t, uint8_t);
  int read();
};
extern WireClass Wire;

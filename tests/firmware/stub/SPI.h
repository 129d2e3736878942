#pragma once
#include "Arduino.h"
enum { MSBFIRST = 1, SPI_MODE1 = 1, SPI_MODE2 = 2 };
struct SPISettings {
  SPISettings(uint32_t, uint8_t, uint8_t);
};
struct SPIClass {
  void begin(), beginTransaction(SPISettings), endTransaction();
  uint8_t transfer(uint8_t);
  uint16_t transfer16(uint16_t);
};
extern SPIClass SPI;

// As much of an Arduino core as the sketch uses, so that a host compiler reads all of it.
#pragma once
#include <stddef.h>
#include <stdint.h>
#include <string.h>
enum { A0 = 20, A1, A2, A3, A4, A5, LOW = 0, HIGH = 1, OUTPUT = 1, INPUT_PULLUP = 2 };
unsigned long micros();
void pinMode(uint8_t, uint8_t);
void digitalWrite(uint8_t, uint8_t);
int digitalRead(uint8_t);
int analogRead(uint8_t);
struct SerialClass {
  void begin(unsigned long);
  int available(), read(), availableForWrite();
  size_t write(const uint8_t *, size_t);
};
extern SerialClass Serial;

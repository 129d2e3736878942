// The sketch's codec on the host. Reads commands from standard input, writes hex lines.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "armd_sensors.h"
#include "armd_wire.h"

static uint8_t packet[ARMD_PACKET_MAX];

static void print(size_t n) {
  for (size_t i = 0; i < n; i++) printf("%02x", packet[i]);
  printf("\n");
}

int main(void) {
  char word[32];
  while (scanf("%31s", word) == 1) {
    unsigned long long a = 0, b = 0, c = 0, d = 0, value = 0;
    int n = 0;
    if (!strcmp(word, "sample") && scanf("%llu %llu %llu %llu %d", &a, &b, &c, &d, &n) == 5) {
      uint32_t counts[ARMD_MAX_JOINTS];
      for (int k = 0; k < n; k++) {
        if (scanf("%llu", &value) != 1) return 1;
        counts[k] = (uint32_t)value;
      }
      print(armd_sample(packet, (uint8_t)a, (uint8_t)b, (uint32_t)c, d, counts, (uint8_t)n));
    } else if (!strcmp(word, "temperature") && scanf("%llu %llu %d", &a, &b, &n) == 3) {
      int16_t centi[ARMD_MAX_SENSORS];
      for (int i = 0; i < n; i++) {
        long long signed_value;
        if (scanf("%lld", &signed_value) != 1) return 1;
        centi[i] = (int16_t)signed_value;
      }
      print(armd_temperature(packet, (uint16_t)a, b, centi, (uint8_t)n));
    } else if (!strcmp(word, "hello") && scanf("%llu %llu %31s %d", &a, &b, word, &n) == 4) {
      uint8_t bits[ARMD_MAX_JOINTS];
      memset(bits, 14, sizeof bits);
      print(armd_hello(packet, (uint8_t)n, 6, (uint16_t)a, (uint32_t)b, word, bits));
    } else if (!strcmp(word, "pong") && scanf("%llu %llu", &a, &b) == 2) {
      print(armd_pong(packet, (uint32_t)a, b));
    } else if (!strcmp(word, "hear")) {
      // bytes as one hex word: what was heard in them
      static char hex[4096];
      armd_listener ear = {{0}, 0};
      if (scanf("%4095s", hex) != 1) return 1;
      printf("heard");
      for (size_t i = 0; hex[i] && hex[i + 1]; i += 2) {
        char two[3] = {hex[i], hex[i + 1], 0};
        uint32_t nonce = 0;
        uint8_t type = armd_hear(&ear, (uint8_t)strtoul(two, NULL, 16), &nonce);
        if (type) printf(" %u:%u", type, nonce);
      }
      printf("\n");
    } else if (!strcmp(word, "as5600") && scanf("%llx", &a) == 1) {
      uint8_t registers[3] = {(uint8_t)(a >> 16), (uint8_t)(a >> 8), (uint8_t)a};
      uint32_t count;
      int good = as5600_decode(registers, &count);
      printf("%d %u\n", good, count);
    } else if (!strcmp(word, "as5047") && scanf("%llx", &a) == 1) {
      uint32_t count;
      int good = as5047_decode((uint16_t)a, &count);
      printf("%d %u\n", good, count);
    } else if (!strcmp(word, "mt6701") && scanf("%llx", &a) == 1) {
      uint32_t count;
      int good = mt6701_decode((uint32_t)a, &count);
      printf("%d %u\n", good, count);
    } else if (!strcmp(word, "ntc") && scanf("%llu %llu", &a, &b) == 2) {
      int16_t centi;
      int good = ntc_decode((uint32_t)a, (uint32_t)b, 10000.0, 3950.0, &centi);
      printf("%d %d\n", good, centi);
    } else {
      return 1;
    }
  }
  return 0;
}

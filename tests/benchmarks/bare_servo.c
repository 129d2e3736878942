/* The least program that can poll servos: write a request, count the bytes of its answers, ask the
   next. bare_servo PORT SECONDS BYTES HEX [BYTES HEX ...] takes the requests in turn, each with the
   bytes of its answers; the period of each cycle goes to standard output, 8-byte floats in s. */

#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { MOST_REQUESTS = 8, MOST_BYTES = 256, PATIENCE_MS = 5000 };

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + (double)t.tv_nsec * 1e-9;
}

int main(int argc, char **argv) {
    unsigned char request[MOST_REQUESTS][MOST_BYTES], answers[4096];
    size_t size[MOST_REQUESTS];
    long wanted[MOST_REQUESTS];
    int n_requests = (argc - 3) / 2;
    if (n_requests < 1 || n_requests > MOST_REQUESTS) return 2;
    for (int i = 0; i < n_requests; i++) {
        const char *hex = argv[4 + 2 * i];
        wanted[i] = atol(argv[3 + 2 * i]);
        size[i] = strlen(hex) / 2;
        if (size[i] > MOST_BYTES) return 2;
        for (size_t j = 0; j < size[i]; j++) sscanf(hex + 2 * j, "%2hhx", &request[i][j]);
    }
    int port = open(argv[1], O_RDWR | O_NOCTTY | O_NONBLOCK);
    struct termios line;
    if (port < 0 || tcgetattr(port, &line)) return 1;
    cfmakeraw(&line);
    cfsetspeed(&line, B1000000);
    if (tcsetattr(port, TCSANOW, &line)) return 1;

    double began = now_s(), last = began, seconds = atof(argv[2]);
    for (int k = 0; last - began < seconds; k = (k + 1) % n_requests) {
        if (write(port, request[k], size[k]) != (ssize_t)size[k]) return 1;
        for (long left = wanted[k]; left > 0;) {
            struct pollfd waiting = {port, POLLIN, 0};
            if (poll(&waiting, 1, PATIENCE_MS) != 1) return 1;
            ssize_t n = read(port, answers, sizeof answers);
            if (n <= 0) return 1;
            left -= n;
        }
        double end = now_s(), period = end - last;
        fwrite(&period, sizeof period, 1, stdout); /* into a buffer, most of the time */
        last = end;
    }
    return 0;
}

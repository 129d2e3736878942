/* armd.point.v1: one point, 136 bytes, little-endian, no padding (docs/reference/subscriber.md).
 * For C11 and C++11, on a little-endian machine; needs nothing else. */
#ifndef ARMD_POINT_H
#define ARMD_POINT_H

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define ARMD_POINT_ENCODING "application/octet-stream;armd.point.v1"

#pragma pack(push, 1)
typedef struct {
    uint64_t seq;              /* epoch << 32 | the device's own number */
    int64_t stamp_ns;          /* instant of the latch, Unix time */
    int64_t monotonic_ns;      /* the same instant, the controller's CLOCK_MONOTONIC */
    double position_mm[3];     /* centre of the tip, base frame; NaN if ARMD_INVALID */
    double orientation[4];     /* quaternion x y z w: turns the last frame into the base frame */
    float covariance_mm2[6];   /* xx xy xz yy yz zz; NaN where not known */
    float correction_mm[3];    /* corrected minus uncorrected */
    uint32_t flags;            /* ARMD_… below */
    uint8_t calibration[8];    /* first bytes of the file's SHA-256, in its order; 0: none */
    uint32_t buttons;          /* bit 0: the first button */
    uint32_t reserved;
} armd_point;
#pragma pack(pop)

#ifdef __cplusplus
static_assert(sizeof(armd_point) == 136, "armd.point.v1 has 136 bytes");
#else
_Static_assert(sizeof(armd_point) == 136, "armd.point.v1 has 136 bytes");
#endif

enum {
    ARMD_INVALID = 1 << 0,
    ARMD_TEMPERATURE_RANGE = 1 << 1,
    ARMD_TEMPERATURE_STALE = 1 << 2,
    ARMD_TEMPERATURE_RATE = 1 << 3,
    ARMD_JOINT_WARNING = 1 << 4,
    ARMD_END_STOP = 1 << 5,
    ARMD_SAMPLES_LOST = 1 << 6,
    ARMD_NOT_CALIBRATED = 1 << 7,
    ARMD_CLOCK = 1 << 8,
    ARMD_AT_REST = 1 << 9
};

/* Counts what is missing. Begin with all zero. */
typedef struct {
    uint64_t upstream; /* never reached the daemon: flag ARMD_SAMPLES_LOST tells of them */
    uint64_t here;     /* published, but lost on the way to you */
    uint64_t restarts; /* new streams: the arm or the daemon started anew */
    uint64_t last_seq;
    int begun;
} armd_lost;

static inline void armd_count(armd_lost *lost, const armd_point *point) {
    if (lost->begun) {
        if (point->seq >> 32 != lost->last_seq >> 32 || point->seq <= lost->last_seq)
            lost->restarts++;
        else if (point->flags & ARMD_SAMPLES_LOST)
            lost->upstream += point->seq - lost->last_seq - 1;
        else
            lost->here += point->seq - lost->last_seq - 1;
    }
    lost->last_seq = point->seq;
    lost->begun = 1;
}

/* Copies a payload; 0 if it is no point. */
static inline int armd_point_from(armd_point *point, const void *payload, size_t size) {
    if (size != sizeof *point) return 0;
    memcpy(point, payload, size);
    return 1;
}

/* "0123456789abcdef", as JSON and `armd check` write it; "-" without a calibration. */
static inline void armd_calibration_text(const armd_point *point, char text[17]) {
    static const uint8_t none[8] = {0, 0, 0, 0, 0, 0, 0, 0};
    if (memcmp(point->calibration, none, sizeof none) == 0) {
        strcpy(text, "-");
        return;
    }
    for (int i = 0; i < 8; i++) snprintf(text + 2 * i, 3, "%02x", point->calibration[i]);
}

#endif

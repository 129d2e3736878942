/* Prints where the tip is, and tells when points were lost.
 *
 *   cc subscriber.c -lzenohc -o subscriber && ./subscriber tcp/127.0.0.1:7447 SIM-0001
 *   cc -DFROM_STDIN subscriber.c -o subscriber && ./subscriber < points.bin
 *
 * The first needs zenoh-c 1.x (https://github.com/eclipse-zenoh/zenoh-c). The second reads recorded
 * points, and needs nothing. docs/reference/subscriber.md has the command that makes points.bin. */
#include "armd_point.h"

static armd_lost lost;

static void take(const void *payload, size_t size) {
    armd_point point;
    char calibration[17];
    if (!armd_point_from(&point, payload, size)) return;
    armd_count(&lost, &point);
    armd_calibration_text(&point, calibration);
    if (point.flags & ARMD_INVALID)
        printf("%llu invalid\n", (unsigned long long)point.seq);
    else
        printf("%llu %.6f %.6f %.6f mm flags %u calibration %s\n", (unsigned long long)point.seq,
               point.position_mm[0], point.position_mm[1], point.position_mm[2], point.flags,
               calibration);
}

static void tell_lost(void) {
    printf("lost: %llu upstream, %llu here, %llu restarts\n", (unsigned long long)lost.upstream,
           (unsigned long long)lost.here, (unsigned long long)lost.restarts);
}

#ifdef FROM_STDIN
int main(void) {
    unsigned char payload[sizeof(armd_point)];
    while (fread(payload, sizeof payload, 1, stdin) == 1) take(payload, sizeof payload);
    tell_lost();
    return 0;
}
#else
#include <zenoh.h>

static void on_sample(z_loaned_sample_t *sample, void *context) {
    unsigned char payload[sizeof(armd_point)];
    const z_loaned_bytes_t *bytes = z_sample_payload(sample);
    z_bytes_reader_t reader = z_bytes_get_reader(bytes);
    (void)context;
    if (z_bytes_len(bytes) == sizeof payload) {
        z_bytes_reader_read(&reader, payload, sizeof payload);
        take(payload, sizeof payload);
    }
}

int main(int argc, char **argv) {
    char text[300];
    z_owned_config_t config;
    z_owned_session_t session;
    z_owned_closure_sample_t callback;
    z_owned_subscriber_t subscriber;
    z_view_keyexpr_t key;

    /* Mode "client": the daemon gossips with nobody, so a peer would find it only if told to. */
    z_config_default(&config);
    zc_config_insert_json5(z_loan_mut(config), "mode", "\"client\"");
    snprintf(text, sizeof text, "[\"%s\"]", argc > 1 ? argv[1] : "tcp/127.0.0.1:7447");
    zc_config_insert_json5(z_loan_mut(config), "connect/endpoints", text);
    zc_config_insert_json5(z_loan_mut(config), "scouting/multicast/enabled", "false");
    if (z_open(&session, z_move(config), NULL) < 0) {
        fprintf(stderr, "no daemon answers at %s\n", text);
        return 2;
    }
    /* "*" is the one arm there is; with several, name one, or their points mix. */
    snprintf(text, sizeof text, "armd/%s/point", argc > 2 ? argv[2] : "*");
    z_view_keyexpr_from_str(&key, text);
    z_closure(&callback, on_sample, NULL, NULL);
    if (z_declare_subscriber(z_loan(session), &subscriber, z_loan(key), z_move(callback), NULL) < 0)
        return 2;
    getchar(); /* until Enter */
    z_drop(z_move(subscriber));
    z_drop(z_move(session));
    tell_lost();
    return 0;
}
#endif

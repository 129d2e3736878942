// Prints where the tip is, and tells when points were lost.
//
//   c++ -std=c++17 subscriber.cpp -lzenohc -o subscriber && ./subscriber tcp/127.0.0.1:7447 SIM-0001
//   c++ -std=c++17 -DFROM_STDIN subscriber.cpp -o subscriber && ./subscriber < points.bin
//
// The first needs zenoh-cpp 1.x over zenoh-c (https://github.com/eclipse-zenoh/zenoh-cpp). The
// second reads recorded points, and needs nothing.
#include <array>
#include <cinttypes>
#include <cstdio>
#include <string>
#include <vector>

#include "armd_point.h"

static void take(const std::vector<std::uint8_t>& payload, armd_lost& lost) {
    armd_point point;
    std::array<char, 17> calibration;
    if (!armd_point_from(&point, payload.data(), payload.size())) return;
    armd_count(&lost, &point);
    armd_calibration_text(&point, calibration.data());
    if (point.flags & ARMD_INVALID)
        std::printf("%" PRIu64 " invalid\n", point.seq);
    else
        std::printf("%" PRIu64 " %.6f %.6f %.6f mm flags %u calibration %s\n", point.seq,
                    point.position_mm[0], point.position_mm[1], point.position_mm[2], point.flags,
                    calibration.data());
}

static void tell(const armd_lost& lost) {
    std::printf("lost: %" PRIu64 " upstream, %" PRIu64 " here, %" PRIu64 " restarts\n",
                lost.upstream, lost.here, lost.restarts);
}

#ifdef FROM_STDIN
int main() {
    armd_lost lost{};
    std::vector<std::uint8_t> payload(sizeof(armd_point));
    while (std::fread(payload.data(), payload.size(), 1, stdin) == 1) take(payload, lost);
    tell(lost);
}
#else
#include <zenoh.hxx>

int main(int argc, char** argv) {
    const std::string endpoint = argc > 1 ? argv[1] : "tcp/127.0.0.1:7447";
    const std::string serial = argc > 2 ? argv[2] : "*";  // the one arm there is
    armd_lost lost{};

    // Mode "client": the daemon gossips with nobody, so a peer would find it only if told to.
    auto config = zenoh::Config::create_default();
    config.insert_json5("mode", "\"client\"");
    config.insert_json5("connect/endpoints", "[\"" + endpoint + "\"]");
    config.insert_json5("scouting/multicast/enabled", "false");
    auto session = zenoh::Session::open(std::move(config));
    auto subscriber = session.declare_subscriber(
        zenoh::KeyExpr("armd/" + serial + "/point"),
        [&lost](const zenoh::Sample& sample) { take(sample.get_payload().as_vector(), lost); },
        zenoh::closures::none);
    std::getchar();  // until Enter
    std::move(subscriber).undeclare();
    tell(lost);
}
#endif

// Follows its leader and stops at red lights, along the route.
//
//     g++ -std=c++17 -O2 -o my_planner my_planner.cpp
//     regents evaluate shipped:standard --planner exec:./my_planner

#include <algorithm>
#include <cmath>

#include "regents_planner.hpp"

class Mine {
   public:
    void reset(const regents::Json& scene) {
        points_.clear();
        for (const auto& point : scene["route"]["points"]) points_.push_back({point.at(0).number(), point.at(1).number()});
    }

    regents::Control act(const regents::Json& seen) {
        const auto& ego = seen["ego"];
        const double speed = ego["speed"].number();
        double gap = 200.0, other = speed;
        if (!seen["leader"].null()) {
            gap = seen["leader"]["gap"].number();
            other = seen["leader"]["agent"]["speed"].number();
        }
        for (const auto& light : seen["lights_ahead"]) {
            const double way = light["gap"].number();
            if (std::string("ryu").find(light["shows"].text()) != std::string::npos && speed * speed < 9.0 * way && way < gap) {
                gap = way;
                other = 0.0;
            }
        }
        const double wanted = 2.0 + std::max(0.0, speed + speed * (speed - other) / 4.9);  // Intelligent Driver Model
        const double accel = 2.0 * (1.0 - std::pow(speed / 13.9, 4) - std::pow(wanted / std::max(gap, 0.1), 2));
        return {std::clamp(accel, -6.0, 2.0), towards(ego, std::max(5.0, speed))};
    }

   private:
    // The curvature to the first point of the route that is this far ahead.
    double towards(const regents::Json& ego, double ahead) const {
        const double x = ego["x"].number(), y = ego["y"].number(), yaw = ego["yaw"].number();
        for (const auto& [px, py] : points_) {
            const double dx = px - x, dy = py - y;
            const double forward = dx * std::cos(yaw) + dy * std::sin(yaw), left = dy * std::cos(yaw) - dx * std::sin(yaw);
            if (forward > 0.0 && std::hypot(dx, dy) >= ahead) return 2.0 * left / (dx * dx + dy * dy);
        }
        return 0.0;
    }

    std::vector<std::pair<double, double>> points_;
};

int main() {
    Mine mine;
    return regents::run(mine);
}

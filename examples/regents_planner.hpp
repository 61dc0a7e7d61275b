// A client for `--planner exec:` in one header of C++17, without other libraries.
//
//     #include "regents_planner.hpp"
//
//     struct Mine {
//         void reset(const regents::Json& scene) {}
//         regents::Control act(const regents::Json& seen) { return {0.0, 0.0}; }
//     };
//
//     int main() {
//         Mine mine;
//         return regents::run(mine);
//     }
//
// regents_cosim/planners/hosting/exec_planner.py documents the keys of `scene` and `seen`: seen["ego"]["speed"].number(),
// for (const auto& other : seen["others"]), seen["leader"].null(). Units: m, s, rad; a positive curvature turns left.
// `act` may return regents::Waypoints. If reset or act throws, the scene is given up for that reason.

#pragma once

#include <cstdlib>
#include <exception>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace regents {

struct Control {
    double accel;      // [m/s^2]
    double curvature;  // [1/m]
};

struct Waypoints {
    std::vector<std::pair<double, double>> points;  // [m] after 1, 2, ... times spacing_s
    double spacing_s = 0.5;
};

// A value of JSON. A key or an index that is not there gives null.
class Json {
   public:
    static Json parse(const std::string& line) {
        const char* at = line.c_str();
        return read(at);
    }

    bool null() const { return kind_ == Kind::null; }
    bool flag() const { return kind_ == Kind::flag && number_ != 0.0; }
    double number() const {
        if (kind_ != Kind::number) throw std::runtime_error("expected a number, found another kind of JSON");
        return number_;
    }
    const std::string& text() const { return text_; }

    std::size_t size() const { return list_.size(); }
    const Json& at(std::size_t index) const { return index < list_.size() ? list_[index] : nothing(); }
    std::vector<Json>::const_iterator begin() const { return list_.begin(); }
    std::vector<Json>::const_iterator end() const { return list_.end(); }
    const Json& operator[](const std::string& key) const {
        const auto found = members_.find(key);
        return found == members_.end() ? nothing() : found->second;
    }

   private:
    enum class Kind { null, flag, number, text, list, object };

    static const Json& nothing() {
        static const Json none;
        return none;
    }

    // The next character that is no space, and past it.
    static char step(const char*& at) {
        while (*at == ' ' || *at == '\t' || *at == '\r' || *at == '\n') ++at;
        return *at == '\0' ? '\0' : *at++;
    }

    static Json read(const char*& at) {
        Json value;
        switch (const char first = step(at)) {
            case '{':
                value.kind_ = Kind::object;
                for (char mark = step(at); mark != '}'; mark = step(at)) {
                    if (mark == ',') mark = step(at);
                    if (mark != '"') throw std::runtime_error("expected a key in JSON");
                    const std::string key = read_text(at);
                    if (step(at) != ':') throw std::runtime_error("expected a colon in JSON");
                    value.members_[key] = read(at);
                }
                return value;
            case '[':
                value.kind_ = Kind::list;
                for (const char* look = at; step(look) != ']'; look = at) {
                    value.list_.push_back(read(at));
                    if (const char* comma = at; step(comma) == ',') at = comma;
                }
                step(at);
                return value;
            case '"':
                value.kind_ = Kind::text;
                value.text_ = read_text(at);
                return value;
            case 't':
            case 'f':
                value.kind_ = Kind::flag;
                value.number_ = first == 't';
                at += first == 't' ? 3 : 4;
                return value;
            case 'n':
                at += 3;
                return value;
            default: {
                char* end = nullptr;
                value.kind_ = Kind::number;
                value.number_ = std::strtod(--at, &end);
                if (end == at) throw std::runtime_error("expected a value in JSON");
                at = end;
                return value;
            }
        }
    }

    // A text after its first quotation mark; \uXXXX stays as it is written.
    static std::string read_text(const char*& at) {
        std::string text;
        while (*at != '"') {
            if (*at == '\0') throw std::runtime_error("a text of JSON has no end");
            if (*at == '\\' && at[1] != 'u' && at[1] != '\0') {
                const char mark = *++at;
                text += mark == 'n' ? '\n' : mark == 't' ? '\t' : mark == 'r' ? '\r' : mark;
            } else {
                text += *at;
            }
            ++at;
        }
        ++at;
        return text;
    }

    Kind kind_ = Kind::null;
    double number_ = 0.0;
    std::string text_;
    std::vector<Json> list_;
    std::map<std::string, Json> members_;
};

inline std::string answer(const Control& control) {
    std::ostringstream line;
    line.precision(17);
    line << "{\"accel\": " << control.accel << ", \"curvature\": " << control.curvature << "}";
    return line.str();
}

inline std::string answer(const Waypoints& way) {
    std::ostringstream line;
    line.precision(17);
    line << "{\"waypoints\": [";
    for (std::size_t i = 0; i < way.points.size(); ++i)
        line << (i ? ", [" : "[") << way.points[i].first << ", " << way.points[i].second << "]";
    line << "], \"spacing_s\": " << way.spacing_s << "}";
    return line.str();
}

inline std::string given_up(const std::string& why) {
    std::string plain;
    for (const char one : why) plain += one == '"' || one == '\\' || static_cast<unsigned char>(one) < ' ' ? ' ' : one;
    return "{\"error\": \"" + plain + "\"}";
}

// Answers every question on standard input until it ends. Print to std::cerr alone: std::cout has the answers.
template <class Planner>
int run(Planner& planner) {
    for (std::string line; std::getline(std::cin, line);) {
        std::string said;
        try {
            const Json question = Json::parse(line);
            if (question["reset"].null()) {
                said = answer(planner.act(question["act"]));
            } else {
                planner.reset(question["reset"]);
                said = "{\"ok\": true}";
            }
        } catch (const std::exception& error) {
            said = given_up(error.what());
        }
        std::cout << said << std::endl;
    }
    return 0;
}

}  // namespace regents

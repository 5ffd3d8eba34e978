#include "tools/ecir/bench_compare.hpp"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::cli {
namespace {

constexpr const char* kStream = ", in a stream";
constexpr double kSlower = 1.1; ///< ratio that runs of one program reach on one machine

std::string describe(const OperationRow& row) {
    return row.name + " " + row.shape;
}

std::string model_text(const std::string& name, const std::string& size, uint32_t frames,
                       uint32_t refine, const std::string& precision) {
    return name + " " + size + ", " + std::to_string(frames) + " frames, refine " +
           std::to_string(refine) + ", " + precision;
}

} // namespace

OldReport::OldReport(std::filesystem::path path) : path_(std::move(path)) {
    const auto bytes = io::read_file(path_);
    try {
        const auto json = nlohmann::json::parse(bytes);
        device_ = json.at("device").get<std::string>();
        const auto add = [&](const nlohmann::json& row, std::string what) {
            if (row.contains("ms")) { // without, its result was wrong
                const double ms = row.at("ms").get<double>();
                const bool quartiles = row.contains("quartiles_ms");
                rows_.push_back({std::move(what), ms,
                                 quartiles ? row["quartiles_ms"].at(1).get<double>() : ms});
            }
        };
        for (const auto& row : json.at("ops")) {
            add(row, row.at("name").get<std::string>() + " " + row.at("shape").get<std::string>());
        }
        for (const auto& row : json.at("models")) {
            const std::string what =
                model_text(row.at("name"), row.at("size"), row.at("frames"), row.at("refine"),
                           row.value("precision", "float32")); // older reports know no other
            add(row, what);
            if (row.contains("stream")) { // nor streams
                add(row["stream"], what + kStream);
            }
        }
    } catch (const nlohmann::json::exception& error) {
        throw Error(ExitCode::bad_input,
                    path_.string() + ": is not a report of ecir bench --json: " + error.what());
    }
    if (std::ranges::any_of(rows_, [](const Row& row) { return !(row.ms > 0); })) {
        throw Error(ExitCode::bad_input, path_.string() + ": has a time that is not above 0");
    }
}

std::vector<ComparedRow> OldReport::compare(const BenchReport& report) const {
    std::vector<ComparedRow> result;
    const auto add = [&](const std::string& what, const Timing& time) {
        const auto old = std::ranges::find(rows_, what, &Row::what);
        if (old != rows_.end()) {
            const bool slower = time.median_ms > kSlower * old->ms &&
                                time.first_quartile_ms > old->third_quartile_ms;
            result.push_back({what, old->ms, time.median_ms, slower});
        }
    };
    for (const OperationRow& row : report.operations) {
        if (row.ok) {
            add(describe(row), row.time);
        }
    }
    for (const ModelRow& row : report.models) {
        if (row.ok) {
            const std::string what =
                model_text(row.name, row.size, row.frames, row.refine, row.precision);
            add(what, row.time);
            add(what + kStream, row.stream);
        }
    }
    if (result.empty()) {
        throw Error(ExitCode::bad_input,
                    path_.string() + ": has none of the operations and models measured now; give "
                                     "a report made with the same --op, --model and --size");
    }
    return result;
}

nlohmann::ordered_json to_json(const std::vector<ComparedRow>& rows) {
    auto json = nlohmann::ordered_json::array();
    for (const ComparedRow& row : rows) {
        json.push_back({{"what", row.what},
                        {"old_ms", row.old_ms},
                        {"new_ms", row.new_ms},
                        {"ratio", row.ratio()},
                        {"regression", row.regression}});
    }
    return json;
}

void print_comparison(const OldReport& old, const std::vector<ComparedRow>& rows) {
    std::printf("\n%-67s %9s %9s %6s\n", ("against " + old.path().string()).c_str(), "old ms",
                "new ms", "ratio");
    for (const ComparedRow& row : rows) {
        std::printf("%-67s %9.3f %9.3f %6.2f%s\n", row.what.c_str(), row.old_ms, row.new_ms,
                    row.ratio(), row.regression ? "  SLOWER" : "");
    }
}

} // namespace ecir::cli

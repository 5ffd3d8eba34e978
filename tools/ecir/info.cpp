#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/ecir/commands.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/recording.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

struct Options {
    fs::path input;
    bool json = false;
};

Json side(std::optional<int> pixels) {
    return pixels ? Json(*pixels) : Json();
}

int64_t median(std::vector<int64_t> values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::ranges::nth_element(values, middle);
    return *middle;
}

/// Of frames: sizes are the first one's.
Json describe_frames(const io::Recording& recording) {
    std::vector<int64_t> durations;
    std::vector<int64_t> distances;
    for (const auto& item : recording.items) {
        if (!durations.empty()) {
            const auto& before = recording.items[durations.size() - 1];
            distances.push_back(item.exposure.start - before.exposure.start);
        }
        durations.push_back(item.exposure.duration());
    }
    const io::Image first = recording.read(recording.items.front());
    Json frames{{"count", recording.items.size()},
                {"width", first.width},
                {"height", first.height},
                {"channels", first.channels},
                {"bits", first.bits},
                {"first_start_us", recording.items.front().exposure.start},
                {"last_end_us", recording.items.back().exposure.end},
                {"exposure_us",
                 {{"least", std::ranges::min(durations)},
                  {"median", median(durations)},
                  {"most", std::ranges::max(durations)}}}};
    frames["apart_us"] = distances.empty() ? Json() : Json(median(distances));
    return frames;
}

Json describe_events(const fs::path& path) {
    const io::EventSummary summary = io::summarize_events(path);
    Json events{{"file", path.filename().string()},
                {"format", summary.format},
                {"width", side(summary.width)},
                {"height", side(summary.height)},
                {"count", summary.events},
                {"positive", summary.positive},
                {"first_us", nullptr},
                {"last_us", nullptr}};
    if (summary.span) {
        events["first_us"] = summary.span->first;
        events["last_us"] = summary.span->last;
    }
    return events;
}

std::string number(const Json& value) {
    return std::to_string(value.get<int64_t>());
}

void print(const Json& info) {
    const Json& events = info["events"];
    const size_t count = events["count"].get<size_t>();
    const std::string size = events["width"].is_null() || events["height"].is_null()
                                 ? std::string()
                                 : ", sensor of " + number(events["width"]) + " x " +
                                       number(events["height"]) + " pixels";
    std::printf("events     %zu in %s, %s%s\n", count, events["file"].get<std::string>().c_str(),
                events["format"].get<std::string>().c_str(), size.c_str());
    if (count > 0) {
        const auto first = events["first_us"].get<int64_t>();
        const auto last = events["last_us"].get<int64_t>();
        std::printf("           from %s to %s us, %.3f s; %.0f %% brighter\n",
                    number(events["first_us"]).c_str(), number(events["last_us"]).c_str(),
                    static_cast<double>(last - first) * 1e-6,
                    100 * events["positive"].get<double>() / static_cast<double>(count));
    }
    if (info["frames"].is_null()) {
        std::printf("frames     none in it: give each image with -i and its --exposure on this "
                    "clock\n");
        return;
    }
    const Json& frames = info["frames"];
    std::printf("frames     %s of %s x %s pixels, %s, %s bits\n", number(frames["count"]).c_str(),
                number(frames["width"]).c_str(), number(frames["height"]).c_str(),
                frames["channels"] == 1 ? "grey" : "colour", number(frames["bits"]).c_str());
    std::printf("           exposed from %s to %s us, for %s us each (%s to %s)%s\n",
                number(frames["first_start_us"]).c_str(), number(frames["last_end_us"]).c_str(),
                number(frames["exposure_us"]["median"]).c_str(),
                number(frames["exposure_us"]["least"]).c_str(),
                number(frames["exposure_us"]["most"]).c_str(),
                frames["apart_us"].is_null()
                    ? ""
                    : (", " + number(frames["apart_us"]) + " us apart").c_str());
}

void run(const Options& options) {
    std::error_code problem;
    Json info;
    if (fs::is_directory(options.input, problem) || io::is_camera_file(options.input)) {
        const io::Recording recording = io::open_recording(options.input);
        info["events"] = describe_events(recording.events);
        info["frames"] = describe_frames(recording);
    } else {
        info["events"] = describe_events(options.input);
        info["frames"] = nullptr;
    }
    if (options.json) {
        std::printf("%s\n", info.dump(2).c_str());
    } else {
        print(info);
    }
}

} // namespace

void add_info(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command =
        app.add_subcommand("info", "Tell what a recording or an events file holds: how many, when");
    command->add_option("-i,--input", options->input, "A recording or an events file")
        ->required()
        ->option_text("PATH (required)");
    command->add_flag("--json", options->json, "Print as JSON");
    command->footer("Times are microseconds on the events' clock, as --exposure takes them.\n"
                    "\n"
                    "Example:\n"
                    "  ecir info -i recording.aedat4");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli

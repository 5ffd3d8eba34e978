#include "tools/ecir/model_times.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <nlohmann/json.hpp>
#include <ranges>

#include "runtime/cache_file.hpp"
#include "tools/ecir/precision.hpp"
#include "tools/ecir/stopwatch.hpp"

namespace ecir::cli {
namespace {

/// What the time depends on; the program's version stands for its kernels.
std::string key_of(const ModelCase& work) {
    const auto path = find_model(work.model);
    std::error_code ignored;
    return work.model + " " + std::to_string(std::filesystem::file_size(path, ignored)) +
           " bytes, " + std::to_string(work.size.width) + "x" + std::to_string(work.size.height) +
           ", " + std::to_string(work.frames) + " frames, ecir " ECIR_VERSION;
}

double measure(const std::shared_ptr<Device>& device, const ModelCase& work) {
    ModelRun run(device, work);
    std::array<double, 4> ms{}; // the first compiles, and estimates thresholds
    for (double& each : ms) {
        const Stopwatch watch;
        (void)run();
        each = watch.ms();
    }
    std::sort(ms.begin() + 1, ms.end());
    return ms[2];
}

} // namespace

ModelTimes::ModelTimes(std::shared_ptr<Device> device)
    : device_(std::move(device)), file_(cache_file(device_->info(), ".times.json")) {
    std::ifstream stream(file_);
    const auto json = nlohmann::json::parse(stream, nullptr, false);
    if (json.is_object()) {
        for (const auto& [key, value] : json.items()) {
            if (value.is_number()) {
                known_[key] = value.get<double>();
            }
        }
    }
}

double ModelTimes::ms(const ModelCase& work) {
    std::string key = key_of(work);
    if (device_->precision() != Precision::float32) {
        key += std::string(", ") + precision_name(device_->precision());
    }
    const auto found = known_.find(key);
    if (found != known_.end()) {
        return found->second;
    }
    const double ms = measure(device_, work);
    known_[key] = ms;
    if (!file_.empty()) {
        write_cache(file_, nlohmann::json(known_).dump(1));
    }
    return ms;
}

BudgetChoice choose_within(double budget_ms, const std::shared_ptr<Device>& device,
                           const PixelSize& size, uint32_t frames) {
    const ModelFamily family = ModelFamily::shipped();
    ModelTimes times(device);
    BudgetChoice choice;
    for (const auto& member : std::views::reverse(family.members())) {
        choice = {member.model,
                  times.ms({.model = member.model, .size = size, .frames = frames, .refine = {}})};
        if (choice.ms <= budget_ms) {
            break;
        }
    }
    return choice;
}

} // namespace ecir::cli

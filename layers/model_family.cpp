#include "layers/model_family.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "layers/deblur.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

double allowed_loss(Quality quality) {
    switch (quality) {
    case Quality::fast:
        return INFINITY;
    case Quality::balanced:
        return 0.5;
    default:
        return 0.1;
    }
}

} // namespace

const char* quality_name(Quality quality) {
    switch (quality) {
    case Quality::fast:
        return "fast";
    case Quality::balanced:
        return "balanced";
    case Quality::best:
        break;
    }
    return "best";
}

ModelFamily::ModelFamily(const std::filesystem::path& file) {
    const auto fail = [&](const std::string& what) -> Error {
        return {ExitCode::bad_input, "model family " + file.string() + ": " + what};
    };
    std::ifstream stream(file);
    if (!stream) {
        throw fail("cannot be read; choose a model with -m, or install the shipped ones anew");
    }
    try {
        const auto json = nlohmann::json::parse(stream);
        for (const auto& entry : json.at("members")) {
            Member member{entry.at("model").get<std::string>(), {}};
            for (const auto& point : entry.at("loss")) {
                member.loss.push_back(
                    {point.at("events_per_pixel").get<double>(), point.at("db").get<double>()});
            }
            members_.push_back(std::move(member));
        }
    } catch (const nlohmann::json::exception& error) {
        throw fail(error.what());
    }
    if (members_.empty()) {
        throw fail("has no members");
    }
    for (size_t i = 0; i < members_.size(); ++i) {
        const auto& loss = members_[i].loss;
        const bool ascending =
            std::ranges::is_sorted(loss, std::ranges::less_equal{}, &Loss::events_per_pixel);
        const bool positive =
            std::ranges::all_of(loss, [](const Loss& point) { return point.events_per_pixel > 0; });
        if (!ascending || !positive || loss.empty() != (i + 1 == members_.size())) {
            throw fail("the losses of " + members_[i].model +
                       " must be by positive, ascending events_per_pixel; all members but the last "
                       "have some");
        }
    }
}

ModelFamily ModelFamily::shipped() {
    return ModelFamily(find_model("fusion").parent_path() / "family.json");
}

double ModelFamily::loss(size_t member, double events_per_pixel) const {
    const auto& points = members_.at(member).loss;
    if (points.empty()) {
        return 0;
    }
    const auto above =
        std::ranges::lower_bound(points, events_per_pixel, {}, &Loss::events_per_pixel);
    if (above == points.begin()) {
        return above->db;
    }
    const Loss& low = *std::prev(above);
    if (above == points.end()) {
        return low.db;
    }
    const double share = std::log(events_per_pixel / low.events_per_pixel) /
                         std::log(above->events_per_pixel / low.events_per_pixel);
    return std::lerp(low.db, above->db, share);
}

size_t ModelFamily::choose(double events_per_pixel, Quality quality, size_t count) const {
    const size_t last = std::clamp<size_t>(count, 1, members_.size()) - 1;
    for (size_t i = 0; i < last; ++i) {
        if (loss(i, events_per_pixel) - loss(last, events_per_pixel) <= allowed_loss(quality)) {
            return i;
        }
    }
    return last;
}

} // namespace ecir

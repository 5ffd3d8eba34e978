#include "tools/stability/run.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

namespace ecir::stability {
namespace {

std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

/// No column ends and no new line inside a table's cell.
std::string cell(std::string text) {
    std::ranges::replace(text, '|', '/');
    std::ranges::replace(text, '\n', ' ');
    return text;
}

} // namespace

std::vector<std::string> Result::series() const {
    std::vector<std::string> names;
    for (const auto& at_value : samples) {
        for (const Sample& sample : at_value) {
            if (std::ranges::find(names, sample.series) == names.end()) {
                names.push_back(sample.series);
            }
        }
    }
    return names;
}

const Sample* Result::find(size_t value, const std::string& series) const {
    const auto found = std::ranges::find(samples[value], series, &Sample::series);
    return found == samples[value].end() ? nullptr : &*found;
}

std::vector<std::string> Result::broken() const {
    std::vector<std::string> all;
    for (size_t i = 0; i < values.size(); ++i) {
        for (const Sample& sample : samples[i]) {
            if (!sweep.holds(sample, values[i])) {
                all.push_back(sweep.name + " at " + label(i) + ": " + sample.series + ": " +
                              (sample.how.empty() ? number(sample.value) : sample.how));
            }
        }
    }
    return all;
}

std::string Result::label(size_t value) const {
    const auto place = std::ranges::find(sweep.values, values[value]) - sweep.values.begin();
    return sweep.labels.empty() || place == std::ssize(sweep.values)
               ? number(values[value])
               : sweep.labels[static_cast<size_t>(place)];
}

Result run(const Sweep& sweep, const Lab& lab, bool quick,
           const std::function<void(size_t)>& told) {
    Result result{sweep, quick ? sweep.quick : sweep.values, {}};
    for (size_t i = 0; i < result.values.size(); ++i) {
        told(i);
        result.samples.push_back(sweep.measure(lab, result.values[i]));
    }
    return result;
}

namespace {

/// Of the failed samples of a series, each once; and where a failure of a scene has none.
std::string warnings(const Result& result, const std::string& series) {
    std::vector<std::string> names;
    std::vector<std::string> without;
    for (size_t i = 0; i < result.values.size(); ++i) {
        const Sample* sample = result.find(i, series);
        if (sample == nullptr || !sample->failed || sample->refused || !sample->warned) {
            continue;
        }
        for (const std::string& name : *sample->warned) {
            if (std::ranges::find(names, name) == names.end()) {
                names.push_back(name);
            }
        }
        if (sample->warned->empty()) {
            without.push_back(result.label(i));
        }
    }
    const auto joined = [](const std::vector<std::string>& parts) {
        std::string text;
        for (const std::string& part : parts) {
            text += (text.empty() ? "" : ", ") + part;
        }
        return text;
    };
    return joined(names) + (!names.empty() && !without.empty() ? "; " : "") +
           (without.empty() ? "" : "nothing at " + joined(without));
}

} // namespace

Failure failure(const Result& result, const std::string& series) {
    std::vector<bool> failed;
    const Sample* worst = nullptr;
    for (size_t i = 0; i < result.values.size(); ++i) {
        const Sample* sample = result.find(i, series);
        failed.push_back(sample != nullptr && sample->failed);
        if (failed.back()) {
            // The last one of a stretch that goes on from mild to severe; the first, if it is that.
            worst =
                worst == nullptr || i + 1 == result.values.size() || !failed[0] ? sample : worst;
        }
    }
    std::string at;
    for (size_t i = 0; i < failed.size();) {
        if (!failed[i]) {
            ++i;
            continue;
        }
        size_t end = i;
        while (end + 1 < failed.size() && failed[end + 1]) {
            ++end;
        }
        at += at.empty() ? "" : "; ";
        if (i == end) {
            at += result.label(i);
        } else if (i == 0 && end + 1 == failed.size()) {
            at += "all values";
        } else {
            at += result.label(i) + " to " + result.label(end);
        }
        i = end + 1;
    }
    return {at.empty() ? "nowhere" : at, worst == nullptr ? "" : worst->how,
            warnings(result, series)};
}

std::string markdown(const std::vector<Result>& results, const std::string& where) {
    std::string text =
        "# Stability\n\nWhere each method begins to fail, condition by condition: `ecir "
        "stability`, " +
        where + ".\n";
    for (const Result& result : results) {
        const Sweep& sweep = result.sweep;
        text += "\n## " + sweep.title + "\n\n![" + sweep.title + "](" + sweep.name + ".svg)\n\n";
        text += "`" + sweep.name + "`. Swept: " + sweep.x.label + ", " + result.label(0) + " to " +
                result.label(result.values.size() - 1) + ". Fails: " + sweep.fails +
                ". What ecir does: " + sweep.safe + ".\n\n";
        text += "| | fails at | how it shows there | warned of as |\n| --- | --- | --- | --- |\n";
        for (const std::string& series : result.series()) {
            if (!result.samples.front().empty() && result.find(0, series) != nullptr &&
                result.find(0, series)->reference) {
                continue;
            }
            const Failure found = failure(result, series);
            text += "| " + cell(series) + " | " + cell(found.at) + " | " + cell(found.how) + " | " +
                    cell(found.warned) + " |\n";
        }
    }
    return text;
}

nlohmann::ordered_json to_json(const Result& result) {
    const Sweep& sweep = result.sweep;
    nlohmann::ordered_json json = {{"name", sweep.name},     {"title", sweep.title},
                                   {"x", sweep.x.label},     {"y", sweep.y.label},
                                   {"fails", sweep.fails},   {"safe", sweep.safe},
                                   {"values", result.values}};
    for (size_t i = 0; i < result.values.size(); ++i) {
        json["labels"].push_back(result.label(i));
    }
    for (const std::string& series : result.series()) {
        nlohmann::ordered_json line = {{"name", series}};
        for (size_t i = 0; i < result.values.size(); ++i) {
            const Sample* sample = result.find(i, series);
            const bool known = sample != nullptr && std::isfinite(sample->value);
            line["values"].push_back(known ? nlohmann::ordered_json(sample->value) : nullptr);
            line["failed"].push_back(sample != nullptr && sample->failed);
            const bool told = sample != nullptr && sample->warned;
            line["warned"].push_back(told ? nlohmann::ordered_json(*sample->warned) : nullptr);
            line["reference"] = sample != nullptr && sample->reference;
        }
        const Failure found = failure(result, series);
        line["fails_at"] = found.at;
        line["how"] = found.how;
        line["warned_of_as"] = found.warned;
        json["series"].push_back(line);
    }
    json["broken"] = result.broken();
    return json;
}

} // namespace ecir::stability

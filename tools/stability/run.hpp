#pragma once
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "tools/stability/sweep.hpp"

namespace ecir::stability {

/// What a sweep found: for each value, in order, a sample of each series.
struct Result {
    Sweep sweep;
    std::vector<double> values;
    std::vector<std::vector<Sample>> samples;

    /// The series in the order in which they came.
    [[nodiscard]] std::vector<std::string> series() const;
    /// One series' samples, by value; nothing where it has none.
    [[nodiscard]] const Sample* find(size_t value, const std::string& series) const;
    /// The samples that break what the sweep promises, as sentences.
    [[nodiscard]] std::vector<std::string> broken() const;
    /// The i-th value with its label.
    [[nodiscard]] std::string label(size_t value) const;
};

/// Runs one sweep, with its quick values or all; told(done) before each value.
Result run(const Sweep& sweep, const Lab& lab, bool quick,
           const std::function<void(size_t done)>& told);

/// The values at which a series fails, from the mildest, and how at the worst of them.
struct Failure {
    std::string at; ///< "nowhere", "2", "2 and more", "0.5 and less; 1.4 and more"
    std::string how;
    std::string warned; ///< names of warnings, and where there is none; empty where no scene failed
};
Failure failure(const Result& result, const std::string& series);

/// Sweep, series by series: fails at, how it shows, what the report warns of, what ecir does.
std::string markdown(const std::vector<Result>& results, const std::string& where);
nlohmann::ordered_json to_json(const Result& result);

/// Its chart: a line a series, references dashed, failures crossed, the limit marked.
std::string line_chart(const Result& result, const std::string& where);

} // namespace ecir::stability

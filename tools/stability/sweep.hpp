#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "layers/deblur.hpp"
#include "tools/ecir/svg.hpp"
#include "tools/stability/capture.hpp"

/// Sweeps of one condition each: where every method, or every form of a computation, begins to
/// fail, and that what ecir does there is safe.
namespace ecir::stability {

/// A method as a sweep runs it.
struct Method {
    std::string name; ///< "ecir, curve"
    DeblurOptions options;
    bool told = false; ///< takes thresholds
};

/// `edi` and fusion networks as they are, ecir networks also without their refinement.
std::vector<Method> methods_of(const std::vector<std::string>& models);

/// What all sweeps work with.
struct Lab {
    std::shared_ptr<Device> device;
    std::vector<Method> methods;
    std::vector<Subject> subjects; ///< at least one; figures are means over them
};

/// What a sweep finds for one series at one value.
struct Sample {
    std::string series;
    double value = 0;       ///< NaN: there is none
    bool failed = false;    ///< by the sweep's definition
    bool reference = false; ///< a theory's or the input's own figure, not a method's: never fails
    bool finite = true;     ///< what it was computed from
    bool refused = false;   ///< an Error with the code for bad input or wrong usage
    std::string how{};      ///< how a failure shows, for a person
    /// Names of the warnings that the report gives for this input (scene_warnings()), where it is a
    /// scene; none unless there is one for each of them.
    std::optional<std::vector<std::string>> warned{};
};

struct Axis {
    std::string label{}; ///< with its unit
    cli::svg::Spread spread = cli::svg::Spread::even;
};

/// Within `low` ... `high` the series must not fail without one of the sweep's warnings: the safe
/// behaviour, which tests hold to.
struct Promise {
    std::string series; ///< how its name begins; empty: all of them
    double low;
    double high;
};

/// A condition from mild to severe, as data.
struct Sweep {
    std::string name; ///< also of its chart: "motion-travel"
    std::string title;
    Axis x;
    Axis y{};
    std::vector<double> values{};
    std::vector<double> quick{};       ///< few of them, for the tests
    std::vector<std::string> labels{}; ///< of the values, where they are kinds and not amounts
    std::string fails{};               ///< what failing means, decided before
    std::string safe{};                ///< what ecir does there
    std::vector<Promise> promises{};
    std::vector<std::string> warnings{}; ///< names that tell of its kind of condition
    std::optional<double> limit{}; ///< of y, drawn; a reference series may be the limit instead
    std::function<std::vector<Sample>(const Lab&, double)> measure{};

    /// Whether what was found at `value` is safe: finite, or refused, and every promise kept.
    [[nodiscard]] bool holds(const Sample& sample, double value) const;
};

std::vector<Sweep> event_sweeps();
std::vector<Sweep> sensor_sweeps();
std::vector<Sweep> motion_sweeps();
std::vector<Sweep> light_sweeps();
std::vector<Sweep> curve_sweeps();
std::vector<Sweep> refinement_sweeps();
std::vector<Sweep> precision_sweeps();

/// All of them, in this order.
std::vector<Sweep> all_sweeps();

} // namespace ecir::stability

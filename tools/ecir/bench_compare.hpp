#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "tools/ecir/bench_report.hpp"

namespace ecir::cli {

/// A measured row beside that of an older report.
struct ComparedRow {
    std::string what; ///< name and shape, or name, size, frames and refinement
    double old_ms = 0;
    double new_ms = 0;
    bool regression = false;
    [[nodiscard]] double ratio() const { return new_ms / old_ms; }
};

/// An older report of `ecir bench --json`, read and checked before anything is measured.
class OldReport {
public:
    /// Throws Error(bad_input) naming the file and what it lacks.
    explicit OldReport(std::filesystem::path path);

    /// The rows that both have: operations of one name and shape, models of one name, size, number
    /// of frames and refinement. A regression is what takes over 10 % longer and whose first
    /// quartile lies above the old third one. Throws Error(bad_input) where no row is in both.
    [[nodiscard]] std::vector<ComparedRow> compare(const BenchReport& report) const;

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const std::string& device() const { return device_; }

private:
    struct Row {
        std::string what;
        double ms = 0;
        double third_quartile_ms = 0;
    };

    std::filesystem::path path_;
    std::string device_;
    std::vector<Row> rows_;
};

nlohmann::ordered_json to_json(const std::vector<ComparedRow>& rows);
void print_comparison(const OldReport& old, const std::vector<ComparedRow>& rows);

} // namespace ecir::cli

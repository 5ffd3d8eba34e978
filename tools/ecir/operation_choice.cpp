#include "tools/ecir/operation_choice.hpp"

#include <regex>

#include "runtime/error.hpp"

namespace ecir::cli {

std::vector<const Operation*> choose_operations(const std::string& pattern) {
    std::regex wanted;
    try {
        wanted = std::regex(pattern);
    } catch (const std::regex_error&) {
        throw Error(ExitCode::usage, "--op '" + pattern + "' is not a regular expression");
    }
    std::vector<const Operation*> chosen;
    for (const Operation& operation : operations()) {
        if (std::regex_search(std::string(operation.name), wanted)) {
            chosen.push_back(&operation);
        }
    }
    if (chosen.empty()) {
        throw Error(ExitCode::usage, "no operation matches --op '" + pattern +
                                         "'; ecir verify without it names all operations");
    }
    return chosen;
}

} // namespace ecir::cli

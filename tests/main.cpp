#define DOCTEST_CONFIG_IMPLEMENT
#include <doctest/doctest.h>

#include <cstdio>

#include "runtime/instance.hpp"

// Any message of the validation layer fails the run, also one that comes when devices are
// destroyed.
int main(int argc, char** argv) {
    doctest::Context context(argc, argv);
    const int result = context.run();
    const auto messages = ecir::validation_messages();
    if (result == 0 && !messages.empty()) {
        std::fprintf(stderr, "%zu validation messages\n", messages.size());
        return 1;
    }
    return result;
}

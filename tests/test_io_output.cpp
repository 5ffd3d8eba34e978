#include <csignal>
#include <cstdint>
#include <doctest/doctest.h>
#include <filesystem>
#include <iterator>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "tests/test_io_support.hpp"
#include "tools/io/output.hpp"

using namespace ecir;
using namespace ecir::test;
namespace fs = std::filesystem;

namespace {

size_t entries(const fs::path& folder) {
    return static_cast<size_t>(std::distance(fs::directory_iterator(folder), {}));
}

} // namespace

TEST_SUITE("io") {

    TEST_CASE("output: a file appears under its name on commit") {
        const TemporaryFolder folder;
        io::PendingOutput output(folder / "out.npy", false, false);
        CHECK(output.path().extension() == ".npy");
        CHECK(output.path().parent_path() == folder.path());
        put(output.path(), "new");
        CHECK_FALSE(fs::exists(folder / "out.npy"));
        output.commit();
        CHECK(get(folder / "out.npy") == "new");
        CHECK(entries(folder.path()) == 1);
    }

    TEST_CASE("output: nothing stays without commit") {
        const TemporaryFolder folder;
        {
            const io::PendingOutput file(folder / "out.mp4", false, false);
            const io::PendingOutput frames(folder / "out", true, false);
            const io::PendingOutput twice(folder / "out", true, false);
            put(file.path(), "half");
            put(frames.path() / "000000.png", "half");
            CHECK(file.path() != folder / "out.mp4");
            CHECK(frames.path() != twice.path());
            CHECK(entries(folder.path()) == 3);
        }
        CHECK(folder.empty());
    }

    TEST_CASE("output: a folder with or without a slash at its end") {
        const TemporaryFolder folder;
        for (const std::string name : {"a", "b/"}) {
            io::PendingOutput output(folder / name, true, false);
            put(output.path() / "frames.csv", "x");
            output.commit();
        }
        CHECK(get(folder / "a/frames.csv") == "x");
        CHECK(get(folder / "b/frames.csv") == "x");
        CHECK(entries(folder.path()) == 2);
    }

    TEST_CASE("output: an existing target is refused without overwrite") {
        const TemporaryFolder folder;
        put(folder / "out.npy", "old");
        fs::create_directory(folder / "out");
        check_error(
            ExitCode::usage, [&] { io::PendingOutput(folder / "out.npy", false, false); },
            "out.npy", "--overwrite");
        check_error(
            ExitCode::usage, [&] { io::PendingOutput(folder / "out", true, false); }, "out",
            "--overwrite");
        CHECK(get(folder / "out.npy") == "old");
        CHECK(entries(folder.path()) == 2);
    }

    TEST_CASE("output: one that appears meanwhile is not replaced without overwrite") {
        const TemporaryFolder folder;
        io::PendingOutput output(folder / "out.npy", false, false);
        put(folder / "out.npy", "other");
        check_error(
            ExitCode::usage, [&] { output.commit(); }, "out.npy", "meanwhile");
        CHECK(get(folder / "out.npy") == "other");
    }

    TEST_CASE("output: overwriting a file keeps the old one until commit") {
        const TemporaryFolder folder;
        put(folder / "out.npy", "old");
        {
            io::PendingOutput output(folder / "out.npy", false, true);
            put(output.path(), "half");
        }
        CHECK(get(folder / "out.npy") == "old");
        io::PendingOutput output(folder / "out.npy", false, true);
        put(output.path(), "new");
        output.commit();
        CHECK(get(folder / "out.npy") == "new");
        CHECK(entries(folder.path()) == 1);
    }

    TEST_CASE("output: overwriting a folder replaces all of it") {
        const TemporaryFolder folder;
        fs::create_directories(folder / "out");
        put(folder / "out/frames.csv", "old");
        put(folder / "out/000099.png", "old");
        io::PendingOutput output(folder / "out", true, true);
        put(output.path() / "frames.csv", "new");
        CHECK(get(folder / "out/frames.csv") == "old");
        output.commit();
        CHECK(get(folder / "out/frames.csv") == "new");
        CHECK(entries(folder / "out") == 1);
        CHECK(entries(folder.path()) == 1);
    }

    TEST_CASE("output: only folders that look like an output are replaced") {
        const TemporaryFolder folder;
        const auto allowed = [&] {
            try {
                const io::PendingOutput made(folder / "out", true, true);
                return true;
            } catch (const Error& error) {
                CHECK(error.code() == ExitCode::usage);
                return false;
            }
        };
        fs::create_directory(folder / "out");
        CHECK(allowed()); // empty
        fs::create_directories(folder / "out/000010");
        CHECK_FALSE(allowed());
        put(folder / "out/000010/frames.csv", "");
        CHECK(allowed()); // a folder of outputs
        put(folder / "out/thesis.tex", "");
        CHECK_FALSE(allowed());
        fs::create_directory(folder / "out/truth");
        CHECK_FALSE(allowed());
        for (const char* report : {"out/chart.json", "out/stability.json", "out/simulation.json"}) {
            put(folder / report, "");
            CHECK(allowed());
            fs::remove(folder / report);
            CHECK_FALSE(allowed());
        }
        CHECK(fs::exists(folder / "out/thesis.tex"));
    }

    TEST_CASE("output: a recording is not mistaken for an output") {
        const TemporaryFolder folder;
        fs::create_directory(folder / "rec");
        put(folder / "rec/exposures.csv", "");
        check_error(
            ExitCode::usage, [&] { io::PendingOutput(folder / "rec", true, true); }, "rec",
            "does not look like");
    }

    TEST_CASE("output: the working folder is not replaced") {
        const fs::path here = fs::current_path();
        check_error(
            ExitCode::usage, [&] { io::PendingOutput(here, true, true); }, "working folder");
        check_error(ExitCode::usage, [&] { io::PendingOutput(here.parent_path(), true, true); });
        check_error(ExitCode::usage, [&] { io::PendingOutput("/", true, true); });
        check_error(
            ExitCode::usage, [&] { io::PendingOutput("", true, true); }, "empty");
    }

    TEST_CASE("output: a file and a folder do not replace each other") {
        const TemporaryFolder folder;
        put(folder / "file", "x");
        fs::create_directory(folder / "out.npy");
        check_error(
            ExitCode::usage, [&] { io::PendingOutput(folder / "file", true, true); }, "file");
        check_error(ExitCode::usage, [&] { io::PendingOutput(folder / "out.npy", false, true); });
    }

    TEST_CASE("output: a link's target is replaced, a device is written directly") {
        const TemporaryFolder folder;
        put(folder / "real.npy", "old");
        fs::create_symlink(folder / "real.npy", folder / "link.npy");
        io::PendingOutput output(folder / "link.npy", false, true);
        put(output.path(), "new");
        output.commit();
        CHECK(get(folder / "real.npy") == "new");
        CHECK(fs::is_symlink(folder / "link.npy"));
        fs::create_symlink("/dev/null", folder / "null.npy");
        {
            io::PendingOutput device(folder / "null.npy", false, true);
            CHECK(device.path() == "/dev/null");
            device.commit();
        }
        CHECK(fs::is_character_file("/dev/null"));
    }

    TEST_CASE("output: places that cannot be written are bad input") {
        const TemporaryFolder folder;
        put(folder / "file", "x");
        for (const bool as_folder : {false, true}) {
            check_error(
                ExitCode::bad_input,
                [&] { io::PendingOutput(folder / "file/out", as_folder, false); }, "file/out");
            check_error(
                ExitCode::bad_input,
                [&] { io::PendingOutput(folder / "none/out", as_folder, false); }, "none/out",
                "folder exists");
            check_error(
                ExitCode::bad_input, [&] { io::PendingOutput("/proc/ecir-out", as_folder, false); },
                "/proc");
        }
    }

    TEST_CASE("output: a long name fits with its suffix") {
        const TemporaryFolder folder;
        const std::string name = std::string(240, 'n') + ".npy";
        io::PendingOutput output(folder / name, false, false);
        output.commit();
        CHECK(fs::exists(folder / name));
    }

    TEST_CASE("output: a signal removes what is pending and ends the process") {
        for (const int number : {SIGINT, SIGTERM}) {
            const TemporaryFolder folder;
            const pid_t child = ::fork();
            REQUIRE(child >= 0);
            if (child == 0) {
                ::alarm(60); // in place of a hang
                (void)std::signal(number, SIG_DFL);
                io::install_cleanup_handler();
                const io::PendingOutput file(folder / "out.npy", false, false);
                const io::PendingOutput frames(folder / "out", true, false);
                put(frames.path() / "000000.png", "half");
                (void)::kill(::getpid(), number);
                ::sleep(20);
                ::_exit(0);
            }
            int status = 0;
            REQUIRE(::waitpid(child, &status, 0) == child);
            CHECK(WIFSIGNALED(status));
            CHECK(WTERMSIG(status) == number);
            CHECK(folder.empty());
        }
    }

    TEST_CASE("output: a regular file that hits the size limit is removed, exit 5") {
        const TemporaryFolder folder;
        const FileSizeLimit limit(1000);
        const std::vector<uint8_t> bytes(5000);
        check_error(
            ExitCode::resources, [&] { io::write_file(folder / "a.bin", {bytes}); }, "a.bin",
            "space");
        CHECK(folder.empty());
    }

} // TEST_SUITE

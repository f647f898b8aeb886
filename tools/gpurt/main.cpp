// The command line of gpurt.
#include <cstdio>
#include <exception>

#include "cli.h"

int main(int argc, char **argv)
{
  CLI::App program(
      "gpurt renders and queries 3D scenes on any CPU and any CUDA GPU.\n\n"
      "A first picture:\n"
      "  gpurt scene cornell -o cornell.glb\n"
      "  gpurt render cornell.glb -o cornell.png --spp 64\n\n"
      "Every command explains itself: gpurt render --help",
      "gpurt");
  program.set_version_flag("--version", fmt::format("gpurt {}.{}.{}", gpurt_version() >> 16,
                                                    gpurt_version() >> 8 & 0xff, gpurt_version() & 0xff));
  program.require_subcommand(1);
  program.footer(
      "Exit status: 0 done, 1 the operation failed (one line on stderr says why), 2 wrong usage, 130 "
      "interrupted.");

  cli::add_devices_command(program);
  cli::add_info_command(program);
  cli::add_render_command(program);
  cli::add_merge_command(program);
  cli::add_trace_command(program);
  cli::add_scene_command(program);
  cli::add_verify_command(program);
  cli::add_bench_command(program);
  cli::add_chart_command(program);

  try {
    program.parse(argc, argv);
    return std::fflush(stdout) == 0 ? cli::exit_ok : throw cli::Failure("standard output cannot be written");
  } catch (const CLI::ParseError &error) {
    // --help and --version are "errors" with code 0, which prints them.
    if (error.get_exit_code() == 0) return program.exit(error);
    const auto chosen = program.get_subcommands();
    fmt::print(stderr, "gpurt: {}; see gpurt{} --help\n", error.what(),
               chosen.empty() ? "" : " " + chosen[0]->get_name());
    return cli::exit_usage;
  } catch (const cli::Failure &failure) {
    if (failure.what()[0] != '\0') fmt::print(stderr, "gpurt: {}\n", failure.what());
    return failure.code();
  } catch (const std::bad_alloc &) {
    fmt::print(stderr, "gpurt: out of memory\n");
  } catch (const std::exception &error) {
    fmt::print(stderr, "gpurt: {}\n", error.what());
  }
  return cli::exit_failure;
}

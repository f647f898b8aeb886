// The command line of gpurt.
#include <algorithm>
#include <cctype>
#include <cstdio>
#include <exception>

#include "cli.h"

namespace cli {

namespace {

// What an option takes in a word, its default beside what it does; the parser's own shows the checks too.
class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_option_opts(const CLI::Option *option) const override
  {
    if (option->get_type_size() == 0) return "";
    std::string type = option->get_type_name();
    type = type.substr(0, type.find(':'));
    if (type == "UINT" || type == "INT") type = "N";
    return (type.empty() ? "" : " " + type) + (option->get_required() ? " (required)" : "");
  }

  std::string make_option_desc(const CLI::Option *option) const override
  {
    const std::string value = option->get_default_str();
    return option->get_description() + (value.empty() ? "" : fmt::format(" (default {})", value));
  }
};

// The parser itself lets 64-bit numbers wrap around.
std::string check_whole_number(const std::string &text)
{
  const bool is_number =
      !text.empty() && text.size() <= 20 &&
      std::all_of(text.begin(), text.end(), [](unsigned char c) { return std::isdigit(c); });
  return is_number && (text.size() < 20 || text <= "18446744073709551615")
             ? std::string()
             : fmt::format("\"{}\" is no whole number from 0 on", text);
}

void add_number_checks(CLI::App &program)
{
  for (CLI::App *command : program.get_subcommands({})) {
    for (CLI::Option *option : command->get_options()) {
      if (option->get_type_name() == "UINT") option->check(CLI::Validator(check_whole_number, ""));
    }
  }
}

std::string names_of_commands(const CLI::App &program)
{
  std::string names;
  for (const CLI::App *command : program.get_subcommands({}))
    names += (names.empty() ? "" : ", ") + command->get_name();
  return names;
}

}  // namespace

}  // namespace cli

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
  program.formatter(std::make_shared<cli::HelpFormatter>());
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

  cli::add_number_checks(program);

  try {
    program.parse(argc, argv);
    return std::fflush(stdout) == 0 ? cli::exit_ok : throw cli::Failure("standard output cannot be written");
  } catch (const CLI::ParseError &error) {
    // --help and --version are "errors" with code 0, which prints them.
    if (error.get_exit_code() == 0) return program.exit(error);
    const auto chosen = program.get_subcommands();
    if (chosen.empty() && argc > 1 && argv[1][0] != '-') {
      fmt::print(stderr, "gpurt: there is no command \"{}\"; the commands are {}\n", argv[1],
                 cli::names_of_commands(program));
      return cli::exit_usage;
    }
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

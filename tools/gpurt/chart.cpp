// gpurt chart: hands over to the Python package, which draws.
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>

#include "cli.h"

namespace cli {

namespace {

const char *python()
{
  const char *chosen = std::getenv("GPURT_PYTHON");
  return chosen && chosen[0] ? chosen : "python3";
}

// Runs a program and waits; its exit status, or 127 where it cannot be started.
int run_program(const std::vector<std::string> &arguments)
{
  std::vector<char *> argv;
  for (const std::string &argument : arguments) argv.push_back(const_cast<char *>(argument.c_str()));
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child < 0) fail("cannot start {}: {}", arguments[0], std::strerror(errno));
  if (child == 0) {
    ::execvp(argv[0], argv.data());
    ::_exit(127);
  }
  int status = 0;
  while (::waitpid(child, &status, 0) < 0) {
    if (errno != EINTR) fail("cannot wait for {}: {}", arguments[0], std::strerror(errno));
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : exit_failure;
}

void run(const std::vector<std::string> &arguments)
{
  constexpr int not_installed = 3;
  const std::string probe = fmt::format(
      "import importlib.util as u, sys; sys.exit(0 if u.find_spec('gpurt') and u.find_spec('gpurt.chart') "
      "else {})",
      not_installed);
  const int found = run_program({python(), "-c", probe});
  if (found == 127)
    fail("gpurt chart needs Python 3, but {} cannot be run; install it or name it in GPURT_PYTHON", python());
  if (found != 0) {
    fail(
        "gpurt chart needs the Python package gpurt, which {} does not have; install it with its drawing "
        "extra: "
        "pip install 'gpurt[chart]', or name another Python in GPURT_PYTHON",
        python());
  }
  std::vector<std::string> command = {python(), "-m", "gpurt.chart"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  // It has said itself what went wrong.
  if (const int status = run_program(command)) throw Failure("", status);
}

}  // namespace

void add_chart_command(CLI::App &program)
{
  auto arguments = std::make_shared<std::vector<std::string>>();
  CLI::App *command = program.add_subcommand(
      "chart", "Chart error over time for every method (calls python3 -m gpurt.chart)");
  command->set_help_flag();
  command->prefix_command();
  command->callback([command] { run(command->remaining()); });
}

}  // namespace cli

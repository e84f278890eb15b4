#include "tools/launcher/machine.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>

#include "common/base/file.hpp"
#include "common/process/children.hpp"

namespace ledgerline::fly {
namespace {

constexpr int max_descriptors = 1'024;

[[noreturn]] void become(const char* program, const char* argument) {
  ::setsid();  // the flight's Ctrl-C is not the browser's
  if (::fork() != 0) ::_exit(0);
  struct sigaction usual {};
  usual.sa_handler = SIG_DFL;
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGPIPE}) ::sigaction(signal, &usual, nullptr);
  const int nothing = ::open("/dev/null", O_RDWR);
  for (int fd = 0; fd < 3; ++fd) ::dup2(nothing, fd);
  for (int fd = 3; fd < max_descriptors; ++fd) ::close(fd);
  ::execl(program, program, argument, nullptr);
  ::_exit(127);
}

}  // namespace

Status open_in_browser(const std::string& url, const std::string& file) {
  const std::string program = find_program("xdg-open");
  if (program.empty()) return Error{"there is no xdg-open here"};
  const std::string page = fmt::format(
      "<!doctype html><meta charset=utf-8><meta name=referrer content=no-referrer>"
      "<meta http-equiv=refresh content=\"0;url={0}\"><title>Ledgerline</title><a href=\"{0}\">To the page</a>\n",
      url);
  if (auto written = replace_file(file, page, 0600); !written) return written;
  const pid_t child = ::fork();
  if (child == 0) become(program.c_str(), file.c_str());
  if (child < 0) return Error{fmt::format("xdg-open is not started: {}", std::strerror(errno))};
  while (::waitpid(child, nullptr, 0) < 0 && errno == EINTR) {
  }
  return done;
}

}  // namespace ledgerline::fly

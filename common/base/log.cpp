#include "common/base/log.hpp"

#include <spdlog/cfg/helpers.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <unistd.h>

#include <cstdlib>

#include "common/base/log/log_ring.hpp"

namespace ledgerline {
namespace {

void use(const std::shared_ptr<spdlog::logger>& logger) {
  spdlog::set_default_logger(logger);
  spdlog::set_pattern("%H:%M:%S.%e %^%l%$ %n: %v");
  const char* level = std::getenv("LEDGERLINE_LOG");
  spdlog::set_level(level ? spdlog::level::from_str(level) : spdlog::level::info);
}

}  // namespace

void init_log(const std::string& program) {
  use(spdlog::stderr_color_mt(program));
  spdlog::flush_on(spdlog::level::info);
}

void log_without_waiting() {
  use(std::make_shared<spdlog::logger>(spdlog::default_logger()->name(), std::make_shared<LogRing>(STDERR_FILENO)));
  spdlog::flush_on(spdlog::level::critical);
}

}  // namespace ledgerline

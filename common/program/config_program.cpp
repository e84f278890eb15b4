#include "common/config/config.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "common/program/stop_signals.hpp"

namespace ledgerline {

int run_with_config(int argc, char** argv, const ConfigProgram& program, const std::function<int(Config&)>& run) {
  CommandLine line(program.name, program.about, program.notes);
  std::string file;
  line.option(program.argument, file, "TOML file").required();
  if (const auto end = line.parse(argc, argv)) return *end;
  catch_stop_signals_of_service();
  outlive_readers();
  auto config = Config::load(file);
  return config ? run(*config) : fail(config.error(), exit_usage);
}

}  // namespace ledgerline

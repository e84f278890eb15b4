#include "hil/fault/catalogue/check.hpp"

#include "common/config/config.hpp"
#include "hil/fault/own/own_code.hpp"
#include "hil/fault/real/real_script.hpp"

namespace ledgerline::hil {

Result<Script> check_script(std::string_view toml, const std::string& file, const std::optional<RealStack>& real) {
  auto script = parse_script(toml, file, true);
  const bool only_real = script && !check_sitl(*script);
  if (!real && !only_real) return parse_script(toml, file);
  if (!script) return script;
  auto config = Config::parse(toml, file);  // it knows the lines
  if (!config) return config.error();
  (void)read_script(*config, file, true);
  for (const NotReal& reason : not_real(*script, real.value_or(RealStack{}))) config->wrong(reason.key, reason.what);
  if (auto status = config->finish(); !status) return status.error();
  return script;
}

}  // namespace ledgerline::hil

#include "hil/proxy/switches.hpp"
#include "tests/fuzz/entry.hpp"

/// What a person tells the proxy: commands with effects and distributions.
namespace ledgerline::fuzz::hil_part {
namespace {

using hil::proxy::Switches;
using hil::proxy::Target;

const std::vector<std::string> commands{
    "drone tello1 to delay 200ms, loss 5%",
    "drone * both jitter gamma 0.46s 0.2s, duplicate 5% 20ms, reorder 5% normal 30ms 5ms",
    "drone tello1 from loss bursts 1% 20% 80% 0.1%, corrupt 1%, truncate 1%",
    "server agent both delay uniform 10ms 50ms, rate 20kB/s queue 8kB",
    "server * from stall",
    "server agent cut",
    "drone tello1 state partition off",
    "clear",
};

/// A command that is taken is listed as commands that give the same again, and can be switched off where it may last.
Outcome command(std::string_view bytes) {
  const std::vector<Target> targets{{Target::Kind::drone, "tello1"}, {Target::Kind::server, "agent"}};
  Switches switches(targets);
  if (const auto applied = switches.apply(bytes); !applied) return refused(applied.error().what);
  const std::string list = switches.list();
  Switches again(targets);
  for (std::size_t begin = 0, end; (end = list.find('\n', begin)) != std::string::npos; begin = end + 1) {
    if (const auto applied = again.apply(std::string_view(list).substr(begin, end - begin)); !applied)
      return refused("");  // which the campaign takes for unclear
  }
  if (again.list() != list) return refused("");
  if (const auto off = hil::proxy::opposite(bytes)) (void)switches.apply(*off);
  return accepted();
}

const Registration commands_entry({"proxy.command", Kind::text,
                                   [] { return std::make_unique<Function>(commands, command); }});

}  // namespace
}  // namespace ledgerline::fuzz::hil_part

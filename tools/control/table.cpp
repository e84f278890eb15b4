#include "tools/control/table.hpp"

#include <fmt/format.h>

#include "common/access/grants.hpp"
#include "common/base/text.hpp"

namespace ledgerline::control {
namespace {

std::string text_of(const Identity& identity) {
  return printable(identity.subject().empty() ? identity.msp_id() + " (its operators and supervisors)"
                                              : identity.msp_id() + " " + identity.subject());
}

}  // namespace

std::string control_table(const std::vector<Control>& controls) {
  std::string table;
  for (const Control& control : controls) {
    table += fmt::format("{}\n  host     {}\n", printable(control.drone()), text_of(control.owner()));
    table += control.has_holder() ? fmt::format("  holder   {}, priority {}, epoch {}\n", text_of(control.holder()),
                                                control.priority(), control.epoch())
                                  : fmt::format("  holder   nobody, epoch {}\n", control.epoch());
    if (control.has_delegate()) table += fmt::format("  commands {}\n", text_of(control.delegate()));
    for (const Identity& who : control.revoked()) table += fmt::format("  revoked  {}\n", text_of(who));
    for (const Stop& stop : control.stoppers()) {
      table += fmt::format("  {:<9}{}\n", stop.cut() ? "cut by" : "stopped", text_of(stop.stopper()));
    }
    for (const Request& request : control.requests()) {
      table += fmt::format("  requests {}, priority {}", text_of(request.who()), request.priority());
      table += request.has_delegate() ? fmt::format(", for {} to command\n", text_of(request.delegate())) : "\n";
    }
    for (const Grant& grant : control.grants()) {
      table += fmt::format("  granted  {}: {}\n", text_of(grant.to()), rights_text(grant));
    }
  }
  return table;
}

}  // namespace ledgerline::control

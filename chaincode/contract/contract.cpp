#include <array>

#include "chaincode/contract/contract_common.hpp"
#include "common/base/check.hpp"
#include "common/base/text.hpp"
#include "common/msg/contract.hpp"

namespace ledgerline::chaincode {
namespace {

struct Function {
  const char* name;
  Answer (*run)(Stub&, const Arguments&);
};

constexpr std::array functions{
    Function{contract::set, set_assets},
    Function{contract::get, get_assets},
    Function{contract::history, get_history},
    Function{contract::delete_, delete_asset},
    Function{contract::enroll, enroll},
    Function{contract::revoke, revoke},
    Function{contract::grant, grant},
    Function{contract::acquire, acquire},
    Function{contract::release, release},
    Function{contract::request, request},
    Function{contract::hand_over, hand_over},
    Function{contract::deny, deny},
    Function{contract::evict, evict},
    Function{contract::command, command},
    Function{contract::stop, stop},
    Function{contract::clear_stop, clear_stop},
    Function{contract::apply_stops, apply_stops},
    Function{contract::claim, claim},
    Function{contract::unclaim, unclaim},
    Function{contract::anchor, anchor},
    Function{contract::verify, verify},
};

/// Refusals quote the call, which may hold anything; they go into text fields, headers and terminals.
Response refuse(const std::string& why) { return {500, printable(why), {}}; }

}  // namespace

Response invoke(Stub& stub, const std::string& function, const std::vector<std::string>& args) {
  for (const Function& known : functions) {
    if (function != known.name) continue;
    const auto call = read_arguments(args);
    if (!call) return refuse(function + ": " + call.error().message);
    try {
      const Answer answer = known.run(stub, *call);
      return answer ? Response{200, {}, *answer} : refuse(answer.error().message);
    } catch (const CheckFailed& failed) {  // nothing is written: the call's set is thrown away with its answer
      return refuse("a check of the contract failed, which is a fault of its own: " + std::string(failed.what()));
    }
  }
  const std::string now(contract::current_name(function));
  std::string names;
  for (const Function& known : functions) names += std::string(names.empty() ? "" : ", ") + known.name;
  return refuse("unknown function " + function + (now == function ? "" : ", which is " + now + " now") +
                "; known are " + names);
}

}  // namespace ledgerline::chaincode

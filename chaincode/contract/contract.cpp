#include <array>

#include "chaincode/contract/contract_common.hpp"

namespace ledgerline::chaincode {
namespace {

struct Function {
  const char* name;
  Response (*run)(Stub&, const Arguments&);
};

constexpr std::array functions{
    Function{"set", set_assets},      Function{"get", get_assets},  Function{"history", get_history},
    Function{"delete", delete_asset}, Function{"enroll", enroll},   Function{"acquire", acquire},
    Function{"release", release},     Function{"command", command}, Function{"stop", stop},
    Function{"resume", resume},       Function{"fold", fold},
};

}  // namespace

Response invoke(Stub& stub, const std::string& function, const std::vector<std::string>& args) {
  for (const Function& known : functions) {
    if (function != known.name) continue;
    const auto call = read_arguments(args);
    return call ? known.run(stub, *call) : refuse(function + ": " + call.error().what);
  }
  std::string names;
  for (const Function& known : functions) names += std::string(names.empty() ? "" : ", ") + known.name;
  return refuse("unknown function " + function + "; known are " + names);
}

}  // namespace ledgerline::chaincode

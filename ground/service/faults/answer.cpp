#include "ground/service/faults/answer.hpp"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "common/base/printable.hpp"
#include "ground/json/strict.hpp"

namespace ledgerline::ground::service {
namespace {

namespace strict = ground::json;
using nlohmann::json;

}  // namespace

ApiAnswer answer_faults(const ApiRequest& request, const ApiContext& known) {
  if (request.method != "GET" && request.method != "POST") return refusal(405, "GET it, or POST one that is switched");
  if (!known.faults) return refusal(404, "there are no faults to switch here: [service] faults is not set");
  if (!known.faults->why.empty()) return refusal(503, known.faults->why);
  if (request.method == "GET") return {200, faults_text(*known.faults)};
  const auto body = strict::object_from(request.body, "the body", {max_body_bytes, 2, 8});
  if (!body) return refusal(400, body.error().what);
  if (const Status keys = strict::only(*body, {"name", "on"}); !keys) return refusal(400, keys.error().what);
  const json name = body->value("name", json()), on = body->value("on", json());
  if (!name.is_string() || !on.is_boolean()) return refusal(400, "needs name, and on: true or false");
  FaultAsk asked{.name = name.get<std::string>(), .on = on.get<bool>()};
  const auto& all = known.faults->switches;
  if (std::none_of(all.begin(), all.end(), [&](const FaultSwitch& one) { return one.name == asked.name; }))
    return refusal(404, "there is no fault \"" + printable(asked.name, strict::max_shown) + "\"");
  // To end one is never wrong, and nobody has to look for a pass phrase.
  if (asked.on && !known.operators.empty() && !request.who)
    return refusal(403, "sign in first: who clicks is who signs; to switch one off needs no operator");
  if (request.who) asked.by = known.operators[*request.who].name;
  return {.status = 200, .body = {}, .fault = std::move(asked)};
}

}  // namespace ledgerline::ground::service

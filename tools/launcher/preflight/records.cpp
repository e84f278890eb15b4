#include "tools/launcher/preflight/records.hpp"

#include <nlohmann/json.hpp>

#include "common/base/printable.hpp"

namespace ledgerline::fly {
namespace {

using nlohmann::json;

std::string text_in(const json& object, const char* key) {
  if (!object.is_object()) return "";
  const auto found = object.find(key);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

crypto::IdentityName identity_in(const json& object) { return {text_in(object, "mspId"), text_in(object, "subject")}; }

std::string words_of(const crypto::IdentityName& who) { return printable(who.msp_id + " " + who.subject); }

LeaseFacts lease_in(const json& record, const crypto::IdentityName& self) {
  LeaseFacts lease;
  lease.holder = LeaseFacts::Holder::free;
  if (record.contains("holder")) {
    const crypto::IdentityName holder = identity_in(record["holder"]);
    const crypto::IdentityName commander = record.contains("delegate") ? identity_in(record["delegate"]) : holder;
    lease.holder = commander != self ? LeaseFacts::Holder::other
                   : holder == self  ? LeaseFacts::Holder::ours
                                     : LeaseFacts::Holder::for_us;
    lease.holder_name = words_of(holder);
    if (commander != holder) lease.holder_name += ", who lets " + words_of(commander) + " command it";
  }
  const json stoppers = record.value("stoppers", json::array());
  for (const json& stop : stoppers)
    lease.stoppers.push_back(words_of(identity_in(stop.is_object() ? stop.value("stopper", json()) : json())));
  return lease;
}

}  // namespace

Status take_records(const std::string& line, const crypto::IdentityName& self, Facts& facts) {
  // Of no record at all it is {}.
  const json message = json::parse(line, nullptr, false);
  const json records = message.is_object() ? message.value("controls", json::array()) : json();
  if (!records.is_array()) return Error{"no control records: " + printable(line)};
  for (DroneFacts& drone : facts.drones) {
    drone.lease = {};
    drone.lease.enrolled = false;
    for (const json& record : records) {
      if (text_in(record, "drone") == drone.name) drone.lease = lease_in(record, self);
    }
  }
  return done;
}

}  // namespace ledgerline::fly

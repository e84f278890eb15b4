#include <algorithm>
#include <map>

#include "chaincode/call.hpp"
#include "chaincode/limits.hpp"

/// set and delete.
namespace ledgerline::chaincode {
namespace {

/// Control records that one call has read, by drone.
using Controls = std::map<std::string, Control>;

/// Whose id it is: the writer's own MSP, or the identity that the first segment is enrolled to.
Status check_owner(Stub& stub, const std::string& id, Controls& controls) {
  const std::string name = first_segment(id);
  if (name == stub.caller().msp_id) return done;
  auto known = controls.find(name);
  if (known == controls.end()) {
    auto control = read_control(stub, name);
    if (!control) return control.error();
    if (!*control) {
      return Error{name + ": not enrolled, and not your organisation (" + stub.caller().msp_id + ")"};
    }
    known = controls.emplace(name, std::move(**control)).first;
  }
  const crypto::IdentityName owner = to_name(known->second.owner());
  if (owner == stub.caller()) return done;
  return Error{name + ": enrolled to " + to_text(owner) + ", not to " + to_text(stub.caller())};
}

bool streams(const Control& control, const std::string& id) {
  return std::find(control.streams().begin(), control.streams().end(), id) != control.streams().end();
}

Result<SetCall> read_set(const Arguments& call) {
  SetCall set;
  if (call.form == Arguments::Form::plain) return Error{"set: give assets in protobuf or JSON"};
  if (call.form == Arguments::Form::json) {
    Asset single;
    if (parse_message(call.message, single)) {
      *set.add_assets() = std::move(single);
      return set;
    }
  }
  if (Status status = parse_message(call.message, set); !status) return status.error();
  return set;
}

Status check_asset(Asset& asset) {
  if (Status status = check_id(asset.id()); !status) return status;
  const std::string topic = "/" + asset.id();
  if (asset.topic().empty()) asset.set_topic(topic);
  if (asset.topic() != topic) return Error{asset.id() + ": the topic is " + asset.topic() + ", it must be " + topic};
  if (asset.msg_type().empty() || asset.msg_type().size() > max_id_chars) {
    return Error{asset.id() + ": msg_type must have 1 to " + std::to_string(max_id_chars) + " characters"};
  }
  if (asset.msg_data().size() > max_asset_bytes) {
    return Error{asset.id() + ": msg_data has " + std::to_string(asset.msg_data().size()) + " bytes; the limit is " +
                 std::to_string(max_asset_bytes)};
  }
  return done;
}

/// The last sample of each id, in order of id.
std::map<std::string, const Asset*> newest(const SetCall& set) {
  std::map<std::string, const Asset*> assets;
  for (const Asset& asset : set.assets()) assets[asset.id()] = &asset;
  return assets;
}

Status write_own_keys(Stub& stub, const SetCall& set, const Controls& controls) {
  for (const auto& [id, asset] : newest(set)) {
    const auto control = controls.find(first_segment(id));
    if (control != controls.end() && streams(control->second, id)) {
      return Error{id + ": it streams; set it with stream, or delete it first"};
    }
    if (Status status = write_stored(stub, asset_key(id), {*asset}); !status) return status;
  }
  return done;
}

/// Writes the caller's frame. A control record is written only when an id streams for the first time: on the hot path
/// it is only read.
Status write_frame(Stub& stub, const SetCall& set, Controls& controls) {
  std::vector<Asset> frame;
  std::size_t bytes = 0;
  std::map<std::string, bool> extended;
  for (const auto& [id, asset] : newest(set)) {
    const auto control = controls.find(first_segment(id));
    if (control == controls.end()) return Error{id + ": only ids under an enrolled name may stream"};
    if (!streams(control->second, id)) {
      control->second.add_streams(id);
      extended[control->first] = true;
    }
    bytes += asset->ByteSizeLong();
    frame.push_back(*asset);
  }
  if (bytes > max_frame_bytes) {
    return Error{"the frame has " + std::to_string(bytes) + " bytes; the limit is " + std::to_string(max_frame_bytes)};
  }
  for (const auto& [drone, yes] : extended) {
    const Control& control = controls.at(drone);
    if (static_cast<std::size_t>(control.streams_size()) > max_drone_streams) {
      return Error{drone + ": " + std::to_string(control.streams_size()) + " ids would stream; the limit is " +
                   std::to_string(max_drone_streams)};
    }
    if (Status status = write_control(stub, control); !status) return status;
  }
  return write_stored(stub, frame_key(stub.caller()), std::move(frame));
}

}  // namespace

Response set_assets(Stub& stub, const Arguments& call) {
  auto set = read_set(call);
  if (!set) return refuse(set.error().what);
  if (set->assets().empty()) return refuse("set: no assets");
  if (static_cast<std::size_t>(set->assets_size()) > max_call_assets) {
    return refuse("the call has " + std::to_string(set->assets_size()) + " assets; the limit is " +
                  std::to_string(max_call_assets));
  }
  Controls controls;
  for (Asset& asset : *set->mutable_assets()) {
    if (Status status = check_asset(asset); !status) return refuse(status.error().what);
    if (Status status = check_owner(stub, asset.id(), controls); !status) return refuse(status.error().what);
  }
  Status written = set->stream() ? write_frame(stub, *set, controls) : write_own_keys(stub, *set, controls);
  if (!written) return refuse(written.error().what);
  stub.set_event("set", write_form(call, *set));
  return {};
}

Response delete_asset(Stub& stub, const Arguments& call) {
  DeleteCall target;
  if (call.form == Arguments::Form::plain) {
    if (call.names.size() != 1) return refuse("delete: give one id");
    target.set_id(call.names[0]);
  } else if (Status status = parse_message(call.message, target); !status) {
    return refuse(status.error().what);
  }
  const std::string& id = target.id();
  if (Status status = check_id(id); !status) return refuse(status.error().what);
  Controls controls;
  if (Status status = check_owner(stub, id, controls); !status) return refuse(status.error().what);

  const auto control = controls.find(first_segment(id));
  if (control != controls.end() && streams(control->second, id)) {
    // The frame itself is not touched: it is written 50 times a second. What is not in the list does not count.
    auto& list = *control->second.mutable_streams();
    list.erase(std::remove(list.begin(), list.end(), id), list.end());
    if (Status status = write_control(stub, control->second); !status) return refuse(status.error().what);
  } else {
    auto stored = read_stored(stub, asset_key(id));
    if (!stored) return refuse(stored.error().what);
    if (!*stored || (*stored)->deleted()) return refuse(id + ": not found");
  }
  Asset tombstone;
  tombstone.set_id(id);
  tombstone.set_topic("/" + id);
  if (Status status = write_stored(stub, asset_key(id), {tombstone}, true); !status) {
    return refuse(status.error().what);
  }
  stub.set_event("delete", write_form(call, target));
  return {};
}

}  // namespace ledgerline::chaincode

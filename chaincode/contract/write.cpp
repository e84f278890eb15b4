#include <map>

#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// set and delete.
namespace ledgerline::chaincode {
namespace {

/// Whose id it is: the writer's own MSP, or the identity that the first segment is enrolled to. `hosts` holds the
/// writer's own record alone.
Status check_owner(Stub& stub, const std::string& id, Records<Host>& hosts) {
  const std::string name = first_segment(id);
  if (name == stub.caller().msp_id) return done;
  const auto host = hosts.at(host_key(stub.caller()));
  if (!host) return host.error();
  if (contains((*host)->drones(), name)) return done;
  const auto control = read_record<Control>(stub, control_key(name));
  if (!control) return control.error();
  if (!*control) {
    return Error{name + ": not enrolled, and not your organisation (" + stub.caller().msp_id +
                 "); an administrator may enroll it"};
  }
  return Error{name + ": enrolled to " + to_text(to_name((*control)->owner())) + ", not to " + to_text(stub.caller()) +
               "; an administrator of " + (*control)->owner().msp_id() + " may enroll it to another"};
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
  if (asset.msg_type().empty() || asset.msg_type().size() > contract::max_id_chars) {
    return Error{asset.id() + ": msg_type must have 1 to " + std::to_string(contract::max_id_chars) + " characters"};
  }
  if (asset.msg_data().size() > contract::max_asset_bytes) {
    return Error{asset.id() + ": msg_data has " + std::to_string(asset.msg_data().size()) + " bytes; the limit is " +
                 std::to_string(contract::max_asset_bytes)};
  }
  return done;
}

/// The last sample of each id, in order of id.
std::map<std::string, const Asset*> newest(const SetCall& set) {
  std::map<std::string, const Asset*> assets;
  for (const Asset& asset : set.assets()) assets[asset.id()] = &asset;
  return assets;
}

/// Whether an id of the writer's lives in its frame.
Result<bool> in_frame(Stub& stub, const std::string& id, Records<Host>& hosts) {
  if (first_segment(id) == stub.caller().msp_id) return false;
  const auto host = hosts.at(host_key(stub.caller()));
  if (!host) return host.error();
  return contains((*host)->streams(), id);
}

Status write_own_keys(Stub& stub, const SetCall& set, Records<Host>& hosts) {
  for (const auto& [id, asset] : newest(set)) {
    const auto streams = in_frame(stub, id, hosts);
    if (!streams) return streams.error();
    if (*streams) return Error{id + ": it streams; set it with stream, or delete it first"};
    if (Status status = write_stored(stub, asset_key(id), {*asset}); !status) return status;
  }
  return done;
}

/// Writes the caller's frame. The host's record is written only when an id streams for the first time: on the hot path
/// it is only read.
Status write_frame(Stub& stub, const SetCall& set, Records<Host>& hosts) {
  const auto host = hosts.at(host_key(stub.caller()));
  if (!host) return host.error();
  Names& streams = *(*host)->mutable_streams();
  std::vector<Asset> batch;
  std::size_t bytes = 0;
  for (const auto& [id, asset] : newest(set)) {
    const std::string drone = first_segment(id);
    if (!contains((*host)->drones(), drone)) return Error{id + ": only ids under an enrolled name may stream"};
    if (!contains(streams, id)) {
      insert(streams, id);
      const auto of_drone = static_cast<std::size_t>(std::count_if(
          streams.begin(), streams.end(), [&](const std::string& one) { return first_segment(one) == drone; }));
      if (of_drone > contract::max_drone_streams) {
        return Error{drone + ": " + std::to_string(of_drone) + " ids would stream; the limit is " +
                     std::to_string(contract::max_drone_streams)};
      }
    }
    bytes += asset->ByteSizeLong();
    batch.push_back(*asset);
  }
  if (Status status = check_limit("the batch has", bytes, "bytes", contract::max_batch_bytes); !status) return status;
  if (Status status = hosts.write(); !status) return status;
  return write_stored(stub, frame_key(stub.caller()), std::move(batch));
}

}  // namespace

Answer set_assets(Stub& stub, const Arguments& call) {
  auto set = read_set(call);
  if (!set) return set.error();
  if (set->assets().empty()) return Error{"set: no assets"};
  if (Status status = check_call_size(set->assets_size(), "assets"); !status) return status.error();
  Records<Host> hosts(stub);
  for (Asset& asset : *set->mutable_assets()) {
    if (Status status = check_asset(asset); !status) return status.error();
    if (Status status = check_owner(stub, asset.id(), hosts); !status) return status.error();
  }
  Status written = set->stream() ? write_frame(stub, *set, hosts) : write_own_keys(stub, *set, hosts);
  if (!written) return written.error();
  // A stream's event names it alone: the transaction has its call and what was written, and this would be a third copy.
  stub.set_event(contract::set, set->stream() ? std::string() : write_form(call, *set));
  return std::string();
}

Answer delete_asset(Stub& stub, const Arguments& call) {
  DeleteCall target;
  if (call.form == Arguments::Form::plain) {
    if (call.names.size() != 1) return Error{"delete: give one id"};
    target.set_id(call.names[0]);
  } else if (Status status = parse_message(call.message, target); !status) {
    return status.error();
  }
  const std::string& id = target.id();
  if (Status status = check_id(id); !status) return status.error();
  Records<Host> hosts(stub);
  if (Status status = check_owner(stub, id, hosts); !status) return status.error();

  const auto streams = in_frame(stub, id, hosts);
  if (!streams) return streams.error();
  if (*streams) {
    // The frame itself is not touched: it is written 50 times a second. What is not in the list does not count.
    erase(*(*hosts.at(host_key(stub.caller())))->mutable_streams(), id);
    if (Status status = hosts.write(); !status) return status.error();
  } else {
    auto stored = read_stored(stub, asset_key(id));
    if (!stored) return stored.error();
    if (!*stored || (*stored)->deleted()) return Error{id + ": not found"};
  }
  Asset tombstone;
  tombstone.set_id(id);
  tombstone.set_topic("/" + id);
  if (Status status = write_stored(stub, asset_key(id), {tombstone}, true); !status) {
    return status.error();
  }
  stub.set_event(contract::delete_, write_form(call, target));
  return std::string();
}

}  // namespace ledgerline::chaincode

#include "chaincode/contract/contract_common.hpp"

#include <algorithm>

#include "common/msg/contract.hpp"

namespace ledgerline::chaincode {

std::string Arguments::option(std::string_view key, std::string otherwise) const {
  for (const auto& [name, value] : options) {
    if (name == key) return value;
  }
  return otherwise;
}

Status check_limit(std::string_view what, std::size_t count, std::string_view unit, std::size_t limit) {
  if (count <= limit) return done;
  return Error{std::string(what) + " " + std::to_string(count) + " " + std::string(unit) + "; the limit is " +
               std::to_string(limit)};
}

Result<Arguments> read_arguments(const std::vector<std::string>& args) {
  std::size_t bytes = 0;
  for (const std::string& arg : args) bytes += arg.size();
  if (Status status = check_limit("the call has", bytes, "bytes", contract::max_call_bytes); !status)
    return status.error();
  Arguments call;
  if (std::all_of(args.begin(), args.end(), is_plain)) {
    for (const std::string& arg : args) {
      const auto equals = arg.find('=');
      if (equals != std::string::npos) {
        call.options.emplace_back(arg.substr(0, equals), arg.substr(equals + 1));
      } else if (!arg.empty()) {
        call.names.push_back(arg);
      }
    }
    return call;
  }
  if (args.size() != 1) return Error{"give one message in protobuf or JSON, or plain ids; not both"};
  call.form = is_json(args[0]) ? Arguments::Form::json : Arguments::Form::protobuf;
  call.message = args[0];
  return call;
}

std::string write_form(const Arguments& call, const google::protobuf::Message& message) {
  return call.json_out() ? to_json(message) : message.SerializeAsString();
}

std::string publish(Stub& stub, const Arguments& call, const std::string& function,
                    const google::protobuf::Message& event) {
  const std::string payload = write_form(call, event);
  stub.set_event(function, payload);
  return payload;
}

Status check_id(const std::string& id) {
  if (id.empty()) return Error{"an asset has no id"};
  if (id.size() > contract::max_id_chars) {
    return Error{id.substr(0, contract::max_id_chars) + "...: the id has " + std::to_string(id.size()) +
                 " characters; the limit is " + std::to_string(contract::max_id_chars)};
  }
  if (!std::all_of(id.begin(), id.end(), contract::is_id_char)) {
    return Error{"an id has characters other than [A-Za-z0-9_./-]"};
  }
  for (std::size_t at = 0; at <= id.size();) {
    const std::size_t end = std::min(id.find('/', at), id.size());
    const std::string_view segment = std::string_view(id).substr(at, end - at);
    if (segment.empty()) return Error{id + ": an id's segments must not be empty"};
    // A client that makes a path or a topic of an id must not end up under another name.
    if (segment == "." || segment == "..") return Error{id + ": an id's segments must not be . or .."};
    at = end + 1;
  }
  return done;
}

std::string first_segment(const std::string& id) { return id.substr(0, id.find('/')); }

Status check_drone_name(const std::string& name) {
  if (Status status = check_id(name); !status) return status;
  if (name.find('/') != std::string::npos) return Error{name + ": a drone's name is one segment, without /"};
  if (name == "asset" || name == "frame" || std::ranges::find(record_kinds, name) != record_kinds.end()) {
    return Error{name + ": a reserved word"};
  }
  if (std::ranges::find(contract::reserved_names, name) != contract::reserved_names.end()) {
    return Error{name + ": ROS 2 or motion capture needs this name"};
  }
  if (name.size() >= 3 && name.compare(name.size() - 3, 3, "MSP") == 0) {
    return Error{name + ": names that end with MSP belong to organisations"};
  }
  return done;
}

Result<std::optional<Stored>> read_stored(Stub& stub, const std::string& key) {
  auto value = stub.get_state(key);
  if (!value) return value.error();
  if (!*value) return std::optional<Stored>{};
  Stored stored;
  if (!stored.ParseFromString(**value)) return Error{"the value of " + key + " is damaged"};
  return std::optional(std::move(stored));
}

Stored signed_by_caller(const Stub& stub, std::vector<Asset> assets) {
  Stored stored;
  *stored.mutable_signer() = to_message(stub.caller());
  for (Asset& asset : assets) *stored.add_assets() = std::move(asset);
  return stored;
}

Status write_stored(Stub& stub, const std::string& key, std::vector<Asset> assets, bool deleted) {
  Stored stored = signed_by_caller(stub, std::move(assets));
  stored.set_deleted(deleted);
  return stub.put_state(key, stored.SerializeAsString());
}

}  // namespace ledgerline::chaincode

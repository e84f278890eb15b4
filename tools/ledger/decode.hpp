#pragma once
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "common/fabric/tx/transaction.hpp"
#include "ledgerline.pb.h"

/// What the ledger holds, decoded for people. Of bytes of unknown form there is the size. What others chose is made
/// printable where it is text. Pure.
namespace ledgerline::ledger {

/// What was asked for: an object of the function's message, or the plain arguments.
nlohmann::ordered_json arguments_json(const std::string& function, const std::vector<std::string>& arguments);
/// {"id","type","value"|"bytes"}
nlohmann::ordered_json asset_json(const Asset& asset);
/// {"transaction","block","channel","code","verdict","time","creator","contract","function","arguments","event",
/// "endorsers"}. Its creator's and endorsers' names are their own claims: `ledgerline receipt` and `audit` prove them.
nlohmann::ordered_json transaction_json(std::uint64_t block, const fabric::Transaction& transaction);
/// Newest first: [{"transaction","time","signer","deleted","asset"}].
nlohmann::ordered_json history_json(const std::vector<Version>& versions);

/// A JSON value as indented lines, "key: value".
std::string lines(const nlohmann::ordered_json& value);

}  // namespace ledgerline::ledger

#pragma once
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/fabric/tx/transaction.hpp"
#include "ledgerline.pb.h"

/// What the ledger holds, decoded for people. Of bytes of unknown form there is the size. What others chose is made
/// printable where it is text. Pure.
namespace ledgerline::ledger {

/// What was asked for: an object of the function's message, or the plain arguments.
nlohmann::ordered_json arguments_json(const std::string& function, const std::vector<std::string>& arguments);
/// {"id","type","value"|"bytes"}
nlohmann::ordered_json asset_json(const Asset& asset);
/// {"transaction","block","block_hash","channel","code","verdict","time","creator","contract","function","arguments",
/// "event","endorsers"}. Its creator's and endorsers' names are their own claims: `ledgerline receipt` and `audit`
/// prove them.
nlohmann::ordered_json transaction_json(const fabric::Block& block, const fabric::Transaction& transaction);
/// Of a chain's blocks: the transaction of an id, or of the beginning of an id that no other begins with.
class TransactionSearch {
 public:
  explicit TransactionSearch(std::string beginning) : beginning_(std::move(beginning)) {}

  bool is_whole_id() const { return beginning_.size() == 64; }
  void add(const std::string& block);
  /// Blocks are missing, and why.
  void add_damage(const std::string& why) { damage_ = why; }
  /// As transaction_json(); of a transaction that came twice, the first.
  Result<nlohmann::ordered_json> result() const;

 private:
  static constexpr std::size_t max_ids = 100;  ///< that are counted

  std::string beginning_, damage_;
  std::set<std::string> ids_;
  std::optional<nlohmann::ordered_json> first_;
};

/// Newest first: [{"transaction","time","signer","deleted","asset"}].
nlohmann::ordered_json history_json(const std::vector<Version>& versions);

/// Where the rest is of what `get` merges into one record; empty: `id` is no control record.
std::string history_note(const std::string& id);

/// A JSON value as indented lines, "key: value".
std::string lines(const nlohmann::ordered_json& value);

}  // namespace ledgerline::ledger

#include <deque>

#include "chaincode/contract/query.hpp"
#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// history.
namespace ledgerline::chaincode {
namespace {

/// Old values of one id under one key, newest first. A frame's other assets, and frames without the id, are left out.
/// While a reader pages, new versions push the old ones down; so the place is a number and the transaction found there.
class KeyReader {
 public:
  KeyReader(Stub& stub, std::string key, std::string id) : stub_(stub), key_(std::move(key)), id_(std::move(id)) {}

  /// "skip:transaction", as place() gave it.
  Status seek(const std::string& place) {
    const auto colon = place.find(':');
    if (colon == std::string::npos || colon == 0 || colon > 15 || place.find_first_not_of("0123456789") != colon) {
      return Error{"the bookmark is damaged"};
    }
    read_ = std::stoull(place.substr(0, colon));
    const std::string sought = place.substr(colon + 1);
    if (sought.empty()) return done;
    if (read_ == 0) return Error{"the bookmark is damaged"};
    --read_;
    for (std::size_t looked = 0; looked < 8 * contract::max_page_versions; ++looked) {
      if (Status status = fill(); !status) return status;
      if (raw_.empty()) break;
      const bool found = raw_.front().tx_id == sought;
      take_raw();
      if (found) return done;
    }
    return Error{"the bookmark is too old; begin again"};
  }

  /// The next one, without taking it; nullptr at the end, or when `budget` is used up.
  Result<const Version*> peek(std::size_t& budget) {
    while (!next_) {
      if (budget == 0) return nullptr;
      if (Status status = fill(); !status) return status.error();
      if (raw_.empty()) return nullptr;
      --budget;
      if (Status status = decode(raw_.front()); !status) return status.error();
      if (!next_) take_raw();
    }
    return &*next_;
  }

  void take(Version& out) {
    out = std::move(*next_);
    next_.reset();
    take_raw();
  }

  bool at_end() const { return end_ && raw_.empty(); }
  std::string place() const { return std::to_string(read_) + ":" + last_; }

 private:
  Status fill() {
    if (!raw_.empty() || end_) return done;
    auto more = stub_.get_history(key_, read_, history_step);
    if (!more) return more.error();
    end_ = more->size() < history_step;
    raw_.assign(std::make_move_iterator(more->begin()), std::make_move_iterator(more->end()));
    return done;
  }

  void take_raw() {
    last_ = raw_.front().tx_id;
    raw_.pop_front();
    ++read_;
  }

  Status decode(const KeyVersion& raw) {
    Stored stored;
    if (!stored.ParseFromString(raw.value)) return Error{"an old value of " + key_ + " is damaged"};
    const Asset* asset = find_in(stored, id_);
    if (asset == nullptr) return done;
    next_.emplace();
    next_->set_tx_id(raw.tx_id);
    next_->set_timestamp_ns(raw.timestamp_ns);
    *next_->mutable_signer() = stored.signer();
    next_->set_deleted(stored.deleted());
    *next_->mutable_asset() = *asset;
    return done;
  }

  Stub& stub_;
  std::string key_, id_;
  std::deque<KeyVersion> raw_;
  std::optional<Version> next_;
  std::size_t read_ = 0;
  std::string last_;
  bool end_ = false;
};

/// Every key that holds or held values of an id.
Result<std::vector<std::string>> keys_of(Stub& stub, const std::string& id) {
  if (is_record(id)) return std::vector<std::string>{id};
  std::vector<std::string> keys{asset_key(id)};
  const std::string name = first_segment(id);
  if (!check_drone_name(name)) return keys;
  const auto control = read_record<Control>(stub, control_key(name));
  if (!control) return control.error();
  if (!*control) return keys;
  keys.push_back(frame_key(to_name((*control)->owner())));
  for (const Identity& former : (*control)->former_owners()) keys.push_back(frame_key(to_name(former)));
  return keys;
}

}  // namespace

Response get_history(Stub& stub, const Arguments& call) {
  const auto query = read_query(call);
  if (!query) return refuse("history: " + query.error().message);
  if (Status status = check_id(query->id()); !status) return refuse(status.error().message);
  const auto keys = keys_of(stub, query->id());
  if (!keys) return refuse(keys.error().message);
  std::vector<KeyReader> sources;
  for (const std::string& key : *keys) sources.emplace_back(stub, key, query->id());
  std::size_t from = 0;
  for (std::size_t i = 0; i < sources.size() && !query->bookmark().empty(); ++i) {
    const std::size_t to = query->bookmark().find('/', from);
    const std::string place = query->bookmark().substr(from, to - from);
    if (Status status = sources[i].seek(place); !status) return refuse(query->id() + ": " + status.error().message);
    if (to == std::string::npos) break;
    from = to + 1;
  }

  Versions page;
  std::size_t bytes = 0, budget = contract::max_page_versions;
  for (;;) {
    KeyReader* newest = nullptr;
    const Version* best = nullptr;
    for (KeyReader& source : sources) {
      const auto version = source.peek(budget);
      if (!version) return refuse(version.error().message);
      if (*version == nullptr && !source.at_end()) {
        newest = nullptr;  // the order is open until the budget of another call
        best = nullptr;
        break;
      }
      if (*version == nullptr) continue;
      if (best == nullptr || (*version)->timestamp_ns() > best->timestamp_ns()) {
        best = *version;
        newest = &source;
      }
    }
    const bool full =
        best != nullptr && !page.versions().empty() && bytes + size_in(call, *best) > contract::max_page_bytes;
    if (newest == nullptr || full) break;
    bytes += size_in(call, *best);
    newest->take(*page.add_versions());
  }
  std::string bookmark;
  bool more = false;
  for (const KeyReader& source : sources) {
    more = more || !source.at_end();
    bookmark += (bookmark.empty() ? "" : "/") + source.place();
  }
  if (more) page.set_bookmark(bookmark);
  if (page.versions().empty() && !more && query->bookmark().empty()) return refuse(query->id() + ": not found");
  return {200, {}, write_form(call, page)};
}

}  // namespace ledgerline::chaincode

#include <algorithm>
#include <deque>
#include <map>

#include "chaincode/contract/records.hpp"
#include "common/msg/contract.hpp"

/// get and history.
namespace ledgerline::chaincode {
namespace {

constexpr std::size_t range_step = 16;
constexpr std::size_t history_step = 32;  ///< old values that are read at a time

Result<QueryCall> read_query(const Arguments& call) {
  QueryCall query;
  if (call.form == Arguments::Form::plain) {
    if (call.names.size() > 1) return Error{"give one id"};
    if (!call.names.empty()) query.set_id(call.names[0]);
    query.set_bookmark(call.option("bookmark", ""));
    return query;
  }
  if (Status status = parse_message(call.message, query); !status) return status.error();
  return query;
}

/// Bytes that a message takes in the answer; base64 and field names make JSON longer.
std::size_t size_in(const Arguments& call, const google::protobuf::Message& message) {
  const std::size_t bytes = message.ByteSizeLong();
  return call.json_out() ? bytes * 4 / 3 + 100 : bytes + 8;
}

bool is_record(const std::string& id) {
  return std::ranges::find(record_kinds, first_segment(id)) != record_kinds.end();
}

const Asset* find_in(const Stored& frame, const std::string& id) {
  for (const Asset& asset : frame.assets()) {
    if (asset.id() == id) return &asset;
  }
  return nullptr;
}

/// Counts the keys that a call looks at, whether they are there, deleted or none of its own: that is what it costs.
class CountingStub final : public Stub {
 public:
  explicit CountingStub(Stub& stub) : stub_(stub) {}

  std::size_t looked() const { return looked_; }

  Result<std::optional<std::string>> get_state(const std::string& key) override {
    ++looked_;
    return stub_.get_state(key);
  }
  Result<std::vector<KeyValue>> get_range(const std::string& start, const std::string& end,
                                          std::size_t limit) override {
    auto some = stub_.get_range(start, end, limit);
    looked_ += some ? some->size() + 1 : 1;
    return some;
  }
  Result<std::vector<KeyVersion>> get_history(const std::string& key, std::size_t skip, std::size_t limit) override {
    return stub_.get_history(key, skip, limit);  // with a bound of its own
  }
  Status put_state(const std::string& key, const std::string& value) override { return stub_.put_state(key, value); }
  Status put_policy(const std::string& key, const std::string& msp_id) override {
    return stub_.put_policy(key, msp_id);
  }
  void set_event(const std::string& name, const std::string& payload) override { stub_.set_event(name, payload); }
  const crypto::IdentityName& caller() const override { return stub_.caller(); }
  bool caller_is_admin() const override { return stub_.caller_is_admin(); }

 private:
  Stub& stub_;
  std::size_t looked_ = 0;
};

/// A record as `get` serves it: a control record is complete.
Status complete(Stub& stub, Asset& record) {
  if (first_segment(record.id()) != "control") return done;
  Control control;
  if (!control.ParseFromString(record.msg_data())) return Error{"the record " + record.id() + " is damaged"};
  if (Status status = complete(stub, control); !status) return status;
  record.set_msg_data(control.SerializeAsString());
  return done;
}

/// Old frames under their keys, newest first, each read once in a call; at most contract::max_page_versions of a key.
class OldFrames {
 public:
  explicit OldFrames(Stub& stub) : stub_(stub) {}

  /// The newest old value of an id under a key.
  Result<std::optional<Asset>> find(const std::string& key, const std::string& id) {
    Frames& frames = all_[key];
    for (std::size_t i = 0; i < contract::max_page_versions; ++i) {
      if (i == frames.read.size()) {
        if (frames.end) break;
        auto more = stub_.get_history(key, i, history_step);
        unavailable_ = !more;
        if (!more) return more.error();
        frames.end = more->size() < history_step;
        looked_ += more->size();
        for (const KeyVersion& version : *more) {
          if (!frames.read.emplace_back().ParseFromString(version.value)) {
            return Error{"an old value of " + key + " is damaged"};
          }
        }
        if (i == frames.read.size()) break;
      }
      if (const Asset* asset = find_in(frames.read[i], id)) return std::optional<Asset>(*asset);
    }
    return std::optional<Asset>{};
  }
  /// The peer has no history, or did not give it when it was asked last.
  bool unavailable() const { return unavailable_; }
  /// How many were read.
  std::size_t looked() const { return looked_; }

 private:
  struct Frames {
    std::deque<Stored> read;
    bool end = false;
  };
  Stub& stub_;
  std::map<std::string, Frames> all_;
  bool unavailable_ = false;
  std::size_t looked_ = 0;
};

/// An id that streams: from the newest frame, else from the frames before it.
Result<std::optional<Asset>> get_streaming(OldFrames& old, const Control& control, const std::string& id,
                                           const std::optional<Stored>& frame) {
  if (frame) {
    if (const Asset* asset = find_in(*frame, id)) return std::optional<Asset>(*asset);
  }
  std::vector<Identity> owners{control.owner()};
  owners.insert(owners.end(), control.former_owners().rbegin(), control.former_owners().rend());
  for (const Identity& owner : owners) {
    auto newest = old.find(frame_key(to_name(owner)), id);
    if (!newest || *newest) return newest;
  }
  return std::optional<Asset>{};
}

Result<std::optional<Asset>> get_own_key(Stub& stub, const std::string& key) {
  auto stored = read_stored(stub, key);
  if (!stored) return stored.error();
  if (!*stored || (*stored)->deleted() || (*stored)->assets_size() != 1) return std::optional<Asset>{};
  return std::optional<Asset>(std::move(*(*stored)->mutable_assets(0)));
}

/// At most three reads: the control record names the host, whose record says where the id lives.
Result<std::optional<Asset>> get_one(Stub& stub, const std::string& id) {
  if (is_record(id)) {
    auto record = get_own_key(stub, id);
    if (!record || !*record) return record;
    if (Status status = complete(stub, **record); !status) return status.error();
    return record;
  }
  const std::string name = first_segment(id);
  if (check_drone_name(name)) {
    const auto control = read_record<Control>(stub, control_key(name));
    if (!control) return control.error();
    if (*control) {
      const crypto::IdentityName owner = to_name((*control)->owner());
      const auto host = read_record<Host>(stub, host_key(owner));
      if (!host) return host.error();
      if (*host && contains((*host)->streams(), id)) {
        const auto frame = read_stored(stub, frame_key(owner));
        if (!frame) return frame.error();
        OldFrames old(stub);
        return get_streaming(old, **control, id, *frame);
      }
    }
  }
  return get_own_key(stub, asset_key(id));
}

/// All control records, or the one of the drone that a prefix names.
Result<std::vector<Control>> controls_for(Stub& stub, const std::string& prefix) {
  std::vector<Control> controls;
  if (!prefix.empty()) {
    auto control = read_record<Control>(stub, control_key(first_segment(prefix)));
    if (!control) return control.error();
    if (*control) controls.push_back(std::move(**control));
    return controls;
  }
  std::string start = "control/";
  for (;;) {
    const auto some = stub.get_range(start, "control0", range_step);
    if (!some) return some.error();
    for (const KeyValue& entry : *some) {
      Stored stored;
      if (!stored.ParseFromString(entry.value) || stored.assets_size() != 1 ||
          !controls.emplace_back().ParseFromString(stored.assets(0).msg_data())) {
        return Error{"the value of " + entry.key + " is damaged"};
      }
    }
    if (some->size() < range_step) return controls;
    start = some->back().key + '\0';
  }
}

/// Newest values of streaming ids that begin with `prefix` and come after `after`, in order of id. When the old frames
/// that one call may look at are used up, the rest is left to the next call.
struct Streaming {
  std::map<std::string, Asset> assets;
  std::optional<std::string> upto;  ///< the last id that was looked for; nullopt: all were
};
Result<Streaming> streaming(CountingStub& stub, const std::string& prefix, const std::string& after) {
  const auto controls = controls_for(stub, prefix);
  if (!controls) return controls.error();
  std::map<std::string, const Control*> wanted;
  Records<Host> hosts(stub);
  for (const Control& control : *controls) {
    const auto host = hosts.at(host_key(to_name(control.owner())));
    if (!host) return host.error();
    for (const std::string& id : (*host)->streams()) {
      if (first_segment(id) == control.drone() && id.compare(0, prefix.size(), prefix) == 0 && id > after) {
        wanted.emplace(id, &control);
      }
    }
  }
  Streaming found;
  std::map<std::string, std::optional<Stored>> frames;
  OldFrames old(stub);
  for (const auto& [id, control] : wanted) {
    if (old.looked() >= contract::max_page_versions || frames.size() >= contract::max_page_versions) return found;
    const std::string key = frame_key(to_name(control->owner()));
    if (!frames.contains(key)) {
      auto frame = read_stored(stub, key);
      if (!frame) return frame.error();
      frames.emplace(key, std::move(*frame));
    }
    auto asset = get_streaming(old, *control, id, frames.at(key));
    // A list has what can be read; a question for this one id gets the error.
    if (!asset && !old.unavailable()) return asset.error();
    if (asset && *asset) found.assets.emplace(id, std::move(**asset));
    found.upto = id;
  }
  found.upto.reset();
  return found;
}

/// One page of the assets whose ids begin with a prefix (empty: all), in order of id. It ends when it has its bytes, or
/// when the keys that one call may look at are used up, with what they have given so far; the bookmark is the last id
/// that was looked at. One call looks at no more, so that no question keeps what waits behind it for long.
class PageReader {
 public:
  PageReader(Stub& stub, const Arguments& call, const std::string& prefix)
      : stub_(stub), call_(call), records_(is_record(prefix)), root_(records_ ? "" : "asset/"), prefix_(prefix) {}

  Result<Assets> read(const std::string& after) {
    if (!records_) {
      auto streams = streaming(stub_, prefix_, after);
      if (!streams) return streams.error();
      waiting_ = std::move(streams->assets);
      last_streaming_ = std::move(streams->upto);
    }
    start_ = std::max(root_ + prefix_, root_ + after + '\0');
    const std::size_t looked_before = stub_.looked();  // how many hosts stream is bounded elsewhere
    for (bool more = true; more || !waiting_.empty();) {
      if (more) {
        const auto full_step = read_step();
        if (!full_step) return full_step.error();
        more = *full_step;
      }
      // While keys are left, only what comes before the next of them is in its final order.
      if (take_before(more ? std::optional(start_.substr(root_.size())) : std::nullopt)) return std::move(page_);
      if (more && stub_.looked() - looked_before >= contract::max_page_keys) {
        std::string last = start_.substr(root_.size());
        last.pop_back();  // the last key itself
        page_.set_bookmark(last_streaming_ ? std::min(*last_streaming_, last) : last);
        return std::move(page_);
      }
    }
    if (last_streaming_) page_.set_bookmark(*last_streaming_);
    return std::move(page_);
  }

 private:
  /// Some of the keys. False: they were the last ones.
  Result<bool> read_step() {
    auto some = stub_.get_range(start_, end_of(root_ + prefix_), range_step);
    if (!some) return some.error();
    for (const KeyValue& entry : *some) {
      Stored stored;
      if (!stored.ParseFromString(entry.value)) return Error{"the value of " + entry.key + " is damaged"};
      if (stored.deleted() || stored.assets_size() != 1) continue;
      if (records_) {
        if (Status status = complete(stub_, *stored.mutable_assets(0)); !status) return status.error();
      }
      waiting_.emplace(stored.assets(0).id(), std::move(*stored.mutable_assets(0)));
    }
    if (!some->empty()) start_ = some->back().key + '\0';
    return some->size() == range_step;
  }

  /// Takes what waits into the page, all of it or what comes before `end`. True: the page is full.
  bool take_before(const std::optional<std::string>& end) {
    while (!waiting_.empty() && (!end || waiting_.begin()->first < *end)) {
      const Asset& asset = waiting_.begin()->second;
      if (last_streaming_ && asset.id() > *last_streaming_) {
        page_.set_bookmark(*last_streaming_);
        return true;
      }
      const std::size_t size = size_in(call_, asset);
      if (!page_.assets().empty() && bytes_ + size > contract::max_page_bytes) {
        page_.set_bookmark(page_.assets(page_.assets_size() - 1).id());
        return true;
      }
      bytes_ += size;
      *page_.add_assets() = asset;
      waiting_.erase(waiting_.begin());
    }
    return false;
  }

  CountingStub stub_;
  const Arguments& call_;
  const bool records_;
  const std::string root_, prefix_;
  std::string start_;
  std::map<std::string, Asset> waiting_;  ///< were found, and have their place in the page behind more keys
  std::optional<std::string>
      last_streaming_;  ///< the last id that was looked for among those that stream; nullopt: all
  Assets page_;
  std::size_t bytes_ = 0;
};

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

Answer get_assets(Stub& stub, const Arguments& call) {
  const auto query = read_query(call);
  if (!query) return Error{"get: " + query.error().message};
  const std::string& id = query->id();
  const bool all = id.empty() || id == "*";
  if (all || (id.size() > 2 && id.compare(id.size() - 2, 2, "/*") == 0)) {
    const std::string prefix = all ? "" : id.substr(0, id.size() - 1);
    if (!all) {
      if (Status status = check_id(id.substr(0, id.size() - 2)); !status) return status.error();
    }
    const auto page = PageReader(stub, call, prefix).read(query->bookmark());
    if (!page) return page.error();
    return write_form(call, *page);
  }
  if (Status status = check_id(id); !status) return status.error();
  auto asset = get_one(stub, id);
  if (!asset) return asset.error();
  if (!*asset) return Error{id + ": not found"};
  if (call.json_out()) return to_json(**asset);
  Assets answer;
  *answer.add_assets() = std::move(**asset);
  return write_form(call, answer);
}

Answer get_history(Stub& stub, const Arguments& call) {
  const auto query = read_query(call);
  if (!query) return Error{"history: " + query.error().message};
  if (Status status = check_id(query->id()); !status) return status.error();
  const auto keys = keys_of(stub, query->id());
  if (!keys) return keys.error();
  std::vector<KeyReader> sources;
  for (const std::string& key : *keys) sources.emplace_back(stub, key, query->id());
  std::size_t from = 0;
  for (std::size_t i = 0; i < sources.size() && !query->bookmark().empty(); ++i) {
    const std::size_t to = query->bookmark().find('/', from);
    const std::string place = query->bookmark().substr(from, to - from);
    if (Status status = sources[i].seek(place); !status) return Error{query->id() + ": " + status.error().message};
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
      if (!version) return version.error();
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
  if (page.versions().empty() && !more && query->bookmark().empty()) return Error{query->id() + ": not found"};
  return write_form(call, page);
}

}  // namespace ledgerline::chaincode

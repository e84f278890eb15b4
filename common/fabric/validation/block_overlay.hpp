#pragma once
#include <map>
#include <set>

#include "common/fabric/tx/form.hpp"
#include "common/fabric/validation/channel_state.hpp"

namespace ledgerline::fabric {

/// What the valid transactions of a block, so far, have written over the state before it.
class BlockOverlay {
 public:
  explicit BlockOverlay(const ChannelState& state) : state_(state) {}

  struct Checked {
    int code = 0;  ///< VALID where each key that was read still has the version that was read, and each range the
                   ///< same keys; else protos.TxValidationCode
    bool unknown = false;  ///< it has read what the state does not know
  };
  Checked check(const ReadWriteSet& sets) const;
  void add(const ReadWriteSet& sets);

  /// Whether an endorsed transaction of this block has set the key's policy: then nobody knows yet what it is.
  bool has_new_policy(const KeyName& key) const { return new_policies_.contains(key); }
  /// Whether a transaction has set it that may have been there before, and then has no effect.
  bool may_have_new_policy(const KeyName& key) const { return possible_policies_.contains(key); }
  void add_possible_policies(const ReadWriteSet& sets);
  /// Also of one that turns out to have read what has changed: Fabric validates endorsements first.
  void add_policies(const ReadWriteSet& sets);

 private:
  /// False only where that is certain.
  bool is_current(const NamespaceSet& part, const kvrwset::KVRead& read) const;
  bool is_current(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range) const;
  bool is_known(const NamespaceSet& part, const kvrwset::KVRead& read) const;
  bool is_known(const NamespaceSet& part, const kvrwset::RangeQueryInfo& range) const;
  bool exists(const KeyName& key) const;

  const ChannelState& state_;
  std::map<KeyName, bool> written_;    ///< true: it is there afterwards
  std::set<KeyName> perhaps_written_;  ///< whether they are there is not known, so neither is whether that counts
  std::set<KeyName> new_policies_, possible_policies_;
};

}  // namespace ledgerline::fabric

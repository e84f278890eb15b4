#include "ground/service/core/certificate_ends.hpp"

#include <algorithm>
#include <utility>

#include "common/msg/contract.hpp"

namespace ledgerline::ground::service {

void CertificateEnds::note(const fabric::Block& block) {
  for (const fabric::Transaction& tx : block.transactions) {
    if (tx.code != 0 || tx.function != contract::set) continue;
    const bool known = std::any_of(writers_.begin(), writers_.end(),
                                   [&](const auto& one) { return one.second.serialized == tx.creator; });
    if (known) continue;
    const auto read = crypto::read_serialized(tx.creator);
    if (!read) continue;  // peers take none such
    const std::int64_t begin_s = read->certificate.not_before_s, end_s = read->certificate.not_after_s;
    const auto found = writers_.find(read->name);
    if (found == writers_.end() && writers_.size() >= max_writers) continue;
    // What was signed before a renewal may come behind it. A newer certificate may end sooner.
    if (found != writers_.end() &&
        std::pair(begin_s, end_s) <= std::pair(found->second.not_before_s, found->second.not_after_s))
      continue;
    writers_.insert_or_assign(
        read->name, Writer{tx.creator,
                           begin_s,
                           end_s,
                           {"agent " + read->name.msp_id + " " + read->name.subject, read->name.subject, end_s}});
  }
}

std::vector<crypto::Renewal::Notice> CertificateEnds::look(std::int64_t now_s) {
  std::vector<crypto::Renewal::Notice> words;
  for (auto& [name, writer] : writers_) {
    if (auto word = writer.renewal.end_notice(now_s)) words.push_back(std::move(*word));
  }
  return words;
}

}  // namespace ledgerline::ground::service

#pragma once
#include <sys/stat.h>

#include <vector>

namespace ledgerline {

/// Whether a secret's file is for whom it is meant alone: its mode is 0600 or less, or it is root's own with reading,
/// and no more, for a group of ours (0440, 0640: a Kubernetes secret with fsGroup). `own_groups`: of this process.
bool is_private(unsigned mode, unsigned owner, unsigned group, const std::vector<unsigned>& own_groups);
/// The same of a file as stat() reports it, for this process.
bool is_private(const struct stat& file);

/// From now on this process leaves no core dump, and no other process of its user may read its memory. Call it before
/// reading a secret. The process' files in /proc then belong to root.
void keep_memory_private() noexcept;

}  // namespace ledgerline

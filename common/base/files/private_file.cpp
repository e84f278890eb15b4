#include "common/base/files/private_file.hpp"

#include <sys/prctl.h>
#include <unistd.h>

#include <algorithm>

namespace ledgerline {
namespace {

std::vector<unsigned> own_groups() {
  std::vector<gid_t> groups(static_cast<std::size_t>(std::max(0, ::getgroups(0, nullptr))));
  groups.resize(static_cast<std::size_t>(std::max(0, ::getgroups(static_cast<int>(groups.size()), groups.data()))));
  groups.push_back(::getegid());
  return {groups.begin(), groups.end()};
}

}  // namespace

bool is_private(unsigned mode, unsigned owner, unsigned group, const std::vector<unsigned>& own_groups) {
  if ((mode & 077) == 0) return true;
  return (mode & 037) == 0 && owner == 0 && std::find(own_groups.begin(), own_groups.end(), group) != own_groups.end();
}

bool is_private(const struct stat& file) { return is_private(file.st_mode, file.st_uid, file.st_gid, own_groups()); }

void keep_memory_private() noexcept { (void)::prctl(PR_SET_DUMPABLE, 0); }  // which cannot fail

}  // namespace ledgerline

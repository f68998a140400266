import { Empty } from '../ui/parts.js';
import type { ViewProps } from '../views.js';

/** Where a scan lies in a map. */
export default function LocalizeView({ path }: ViewProps) {
  return <Empty title={path.join(' – ')}><p>Not built yet.</p></Empty>;
}

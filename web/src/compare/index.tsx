import { Empty } from '../ui/parts.js';
import type { ViewProps } from '../views.js';

/** Two versions beside each other. */
export default function CompareView({ path }: ViewProps) {
  return <Empty title={path.join(' – ')}><p>Not built yet.</p></Empty>;
}
